"""Files and texts read within bounds: whole regular files and YAML.

Every fault is an `Unreadable`, which names the file and the place in it. Pipes and devices are
refused, because a reader would wait for them or never end.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, get_args

import yaml

from patagium.errors import LogError, PatagiumError, Unreadable, shown, similar, told_problems
from patagium.limits import ENTRIES, NESTING, SHOWN, YAML_TEXT, free_memory, in_bytes

_PIECE = 1 << 24  # B that are expanded at a time
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def beside(file: Path, name: str) -> str:
    """Path of a file in the folder of another file; the name as given if there is no such file."""
    place = os.path.join(file.parent, name)
    return place if os.path.isfile(place) else name  # Path would fail where a name is too long


def regular_file(path: str | Path, most: int | None = None) -> Path:
    """Path of a file that can be read from its beginning to its end.

    Args:
        path: The file.
        most: Largest size [B]; None for any.

    Raises:
        Unreadable: If there is no such file, it is a folder, a pipe or a device, or too large.
    """
    file = Path(path)
    try:
        found = file.stat()
    except (OSError, ValueError) as problem:  # of a null byte in the path
        reason, near = getattr(problem, "strerror", None) or str(problem), ""
        if isinstance(problem, FileNotFoundError):
            with suppress(OSError):
                near_by = [Path(name) for name in os.listdir(file.parent)]
                alike = {one.stem: one.name for one in near_by if one.suffix == file.suffix}
                near = similar(file.stem, alike)
            reason = f"no such file{near}"
        raise Unreadable(path, "", "a file that can be read", reason) from None
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe or device"
        raise Unreadable(path, "", "a regular file", f"{kind}; write it to a file first")
    if most is not None and found.st_size > most:
        raise Unreadable(path, "", f"at most {most} bytes", f"{found.st_size} bytes")
    return file


def check_room(path: Path, size: int, what: str = "") -> None:
    """Refuse what has to be in memory at once and would take too much of it.

    Args:
        path: The file.
        size: Memory that is needed [B].
        what: Part of the file that needs it.

    Raises:
        Unreadable: If it is more than a quarter of the free memory.
    """
    most = free_memory() // 4
    if size > most:
        expected = f"at most {in_bytes(most)} at once, a quarter of the free memory"
        remedy = "save it in parts, or as CSV or Parquet, which are read block by block"
        raise Unreadable(path, what, expected, f"{in_bytes(size)}; {remedy}")


def expanded(path: Path, stream: Any, content: bytes | memoryview, before: int = 0) -> bytes:
    """Content of a compressed part of a file, as far as the memory has room for it.

    Args:
        path: The file.
        stream: Decompressor, such as `zlib.decompressobj()`.
        content: The part.
        before: Size of what was expanded before it and is still held [B].

    Raises:
        Unreadable: If it takes too much memory, or is cut off.
    """
    parts: list[bytes] = []
    size, rest = before, content
    while not stream.eof:
        parts.append(stream.decompress(rest, _PIECE))
        rest = getattr(stream, "unconsumed_tail", b"")
        if not parts[-1] and not stream.eof:
            raise Unreadable(path, "", "a compressed part with its end", "one that is cut off")
        size += len(parts[-1])
        check_room(path, size, "compressed parts")
    return b"".join(parts)


def bytes_of(path: str | Path, most: int) -> bytes:
    """Content of a regular file.

    Args:
        path: The file.
        most: Largest size [B].

    Raises:
        Unreadable: If it cannot be read, or is too large.
    """
    try:
        return regular_file(path, most).read_bytes()
    except OSError as problem:
        raise Unreadable(path, "", "a file that can be read", str(problem.strerror)) from None


def text_of(path: str | Path, most: int) -> str:
    """Text of a regular file in UTF-8.

    Args:
        path: The file.
        most: Largest size [B].

    Raises:
        Unreadable: If it cannot be read, is too large, or is no text in UTF-8.
    """
    try:
        return bytes_of(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise Unreadable(path, f"byte {problem.start}", "text in UTF-8", "other bytes") from None


def parsed_json(text: str | bytes, name: str) -> Any:
    """Content of a JSON text, without half characters.

    Raises:
        Unreadable: If it is none.
    """
    try:
        written = text.decode("utf-8") if isinstance(text, bytes) else text
        words = json.loads(written)
        if _SURROGATE.search(written):
            json.dumps(words, ensure_ascii=False).encode("utf-8")
    except UnicodeError:
        raise Unreadable(name, "", "text in UTF-8", "bytes or half of a character") from None
    except json.JSONDecodeError as problem:
        where = f"line {problem.lineno}, column {problem.colno}"
        raise Unreadable(name, where, "JSON", problem.msg) from None
    except (ValueError, RecursionError) as problem:  # a number of thousands of digits
        raise Unreadable(name, "", "JSON", shown(problem, 120)) from None
    return words


def json_object(text: str | bytes, name: str) -> dict[str, Any]:
    """Mapping that a JSON text holds.

    Raises:
        Unreadable: If it is no JSON, or another kind of value.
    """
    words = parsed_json(text, name)
    if not isinstance(words, dict):
        raise Unreadable(name, "", "a JSON object", shown(words))
    return words


def json_ready(value: Any) -> Any:
    """Values and arrays as JSON values; numbers that are not finite, which JSON lacks, are null."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    if hasattr(value, "tolist"):
        return json_ready(value.tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


@contextmanager
def made_again(what: str, kind: type[PatagiumError] = LogError) -> Iterator[None]:
    """Guard around making something again from words of a file, which may be any words.

    Args:
        what: What is made, with its file.
        kind: Error to raise.

    Raises:
        PatagiumError: Of that kind, if it cannot be made.
    """
    try:
        yield
    except Exception as problem:  # of wrong words Python and NumPy have errors of every kind
        reason = str(problem) if isinstance(problem, PatagiumError) else repr(problem)
        raise kind(f"{what} cannot be made again: {reason[:1000]}") from problem


def _refusal(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


class _Loader(yaml.SafeLoader):
    """YAML with each key once, of bounded depth and size, aliases written out or refused."""

    def __init__(self, stream: Any, aliases: bool = True) -> None:
        super().__init__(stream)
        self._aliases = aliases
        self._depth = self._entries = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        alias = self.check_event(yaml.AliasEvent)
        if alias and not self._aliases:
            raise _refusal("values written out, no alias", mark)
        before, self._depth = self._entries, self._depth + 1
        if self._depth > NESTING:
            raise _refusal(f"at most {NESTING} levels", mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if alias and id(node) not in self._sizes:
            raise _refusal("no value that holds itself", mark)
        self._entries += self._sizes[id(node)] if alias else 1
        self._sizes[id(node)] = self._entries - before
        if self._entries > ENTRIES:
            raise _refusal(f"at most {ENTRIES} entries", mark)
        return node

    def construct_scalar(self, node: Any) -> Any:
        value = super().construct_scalar(node)
        if isinstance(value, str) and any("\ud800" <= sign <= "\udfff" for sign in value):
            raise _refusal("whole characters, found half of one", node.start_mark)
        return value

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in getattr(node, "value", ()):
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise _refusal("keys that are names, found a collection", key_node.start_mark)
            if key in seen:
                raise _refusal(f"each key once, found {shown(key)} again", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def parsed_yaml(text: str, name: str, *, aliases: bool = True) -> Any:
    """Content of a YAML text.

    Args:
        text: The text.
        name: What to call it in errors.
        aliases: Whether values may be written once and named elsewhere (`&a`, `*a`).

    Raises:
        Unreadable: If it is no YAML, too deep or too long, or has a key twice.
    """
    if len(text) > YAML_TEXT:  # such as that of a robot in a flight or a network
        raise Unreadable(name, "", f"at most {YAML_TEXT} characters of YAML", f"{len(text)}")
    try:
        return yaml.load(text, Loader=partial(_Loader, aliases=aliases))  # type: ignore[arg-type] # noqa: S506
    except yaml.MarkedYAMLError as error:
        raise Unreadable(name, *_yaml_fault(text, error)) from None
    except (
        yaml.YAMLError,
        ValueError,
        ArithmeticError,
        LookupError,  # the constructors of explicit tags, such as !!bool x
        AttributeError,
        TypeError,
        RecursionError,
    ) as error:
        found = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise Unreadable(name, "", "readable YAML", found) from None


_UNENDED = {
    "simple key": "`key: value` with a colon and a space",
    "flow mapping": "a comma between entries, or a } that closes the { of this line",
    "flow sequence": "a comma between entries, or a ] that closes the [ of this line",
    "quoted scalar": "a quote that closes the one of this line",
}
"""What a text lacks from the line on where YAML says that it began to read one of these."""


def _yaml_fault(text: str, error: yaml.MarkedYAMLError) -> tuple[str, str, str]:
    """Place of a fault in a YAML text, what is expected there, and what was found."""
    mark, problem, rows = error.problem_mark or error.context_mark, error.problem, text.splitlines()
    line, part = mark.line if mark else 0, str(error.context).rpartition(" a ")[2]
    begun = error.context_mark.line if error.context_mark else line
    if str(problem).startswith("mapping values"):  # of a text that goes on from the line before
        begun = max([k for k in range(line) if rows[k].split("#")[0].strip()], default=line)
        part = "" if begun == line or re.search(r":(\s|$)", rows[begun]) else "simple key"
    where = f"line {line + 1}, column {mark.column + 1}" if mark else ""
    if part in _UNENDED:
        found = f"none up to {where if line < len(rows) else 'the end'}"
        found = shown(rows[begun].strip()) if part == "simple key" else found
        return f"line {begun + 1}", _UNENDED[part], found
    if found := _indented(text, line, str(problem)):
        return where, "readable YAML", found
    if str(problem).startswith("mapping values"):
        return where, "one `key: value` a line", "a second colon"
    return where, "readable YAML", shown(problem or error.context, 200)


def _indented(text: str, line: int, problem: str) -> str:
    """Fault of the indentation where YAML ended, or nothing."""
    rows = [row for row in text.splitlines()[: line + 1] if row.split("#")[0].strip()]
    sizes = [len(row) - len(row.lstrip()) for row in ["", *rows]]
    if "\t" in rows[-1][: sizes[-1]]:
        return "a tab; indent by spaces"
    deeper = problem.startswith("mapping values") and sizes[-1] > sizes[-2]
    if deeper or (problem.startswith("expected <block end>") and sizes[-1] != sizes[-2]):
        return f"a line indented by {sizes[-1]} spaces after one by {sizes[-2]}"
    return ""


def refused(source: str, errors: Sequence[Any], model: Any, text: str = "") -> LogError:
    """Error of a file whose values pydantic refused, one line for each problem.

    Args:
        source: Name of the file.
        errors: Problems, from `ValidationError.errors()`.
        model: Class of the file's content.
        text: Text of the file, for the numbers of lines.
    """
    problems = faults(errors, model)
    lines = lines_of(text, [where for where, *_ in problems])
    return LogError(told_problems(source, problems, lines))


def faults(errors: Sequence[Any], model: Any) -> list[tuple[str, str, str]]:
    """Place, what is expected there and what was found, of each value that pydantic refused.

    A misspelled key is told once, not as a missing key too.
    """
    inner = {error["loc"][:k] for error in errors for k in range(len(error["loc"]))}
    found = [
        _fault(error, model)
        for error in errors
        if (error["type"] != "too_short" or error["loc"] not in inner)
        and not (error["type"] == "dict_type" and "[" in str(error["loc"][-1]))  # a union's other
    ]
    meant = {
        (where.rpartition(".")[0], seen.rpartition("did you mean ")[2].removesuffix("?"))
        for where, _, seen in found
    }
    return [k for k in found if k[2] != "nothing" or k[0].rpartition(".")[::2] not in meant]


def _fault(error: Any, model: Any) -> tuple[str, str, str]:
    """Place, expectation and finding of an error of pydantic, in words."""
    kind, context = error["type"], error.get("ctx", {})
    loc = [k for k in error["loc"] if "[" not in str(k)]  # of a key, or a type of a union
    where = ".".join(k if len(k) <= SHOWN else k[: SHOWN - 3] + "..." for k in map(str, loc))
    if kind == "mismatch":
        return ".".join(filter(None, (where, context["at"]))), context["expected"], context["found"]
    parts = _parts_at(model, loc[:-1])
    if kind == "extra_forbidden":
        known = sorted({field.alias or name for k in parts for name, field in _fields(k)})
        expected = f"one of the keys {', '.join(known)}" if known else "no such key"
        return where, expected, shown(loc[-1]) + similar(loc[-1], known)
    tags = str(context.get("expected_tags") or context.get("expected", "")).replace(" or ", ", ")
    if kind in ("union_tag_invalid", "literal_error", "enum"):
        names = tags.replace("'", "").split(", ")
        seen = context.get("tag", error["input"])
        where = f"{where}.type" if "tag" in context else where
        return where, f"one of {', '.join(names)}", shown(seen) + similar(seen, names)
    said = _SENTENCE.fullmatch(error["msg"].removeprefix("Value error, "))
    if said:  # of a validator of our own
        own, given = said[1] if [said[1]] != loc[-1:] else "", error["input"]
        seen = said[3] or (_parts_of(given, own) if own else shown(given))
        return ".".join(filter(None, (where, own))), said[2] or said[4], seen
    words = _EXPECTED.get(kind, error["msg"].removeprefix("Value error, "))
    words = re.sub("^(greater|less)", r"a number \1", words.removeprefix("Input should be "))
    found = [f for k in parts for name, f in _fields(k) if loc and loc[-1] in (name, f.alias)]
    meant = next((f for f in found if f.examples), None)
    example = str(meant.examples[0]) if meant else ""
    if kind == "missing":
        such = meant and f"{meant.description or 'a value'} such as `{loc[-1]}: {example}`"
        return where, such or "a value here", "nothing"
    seen = "nothing" if error["input"] is None else shown(error["input"])
    return where, f"{words} such as {example}" if example else words, seen


def _parts_of(given: Any, names: str) -> str:
    """Values of keys such as "column, field" of what was given, in words."""
    found = {k: given[k] for k in names.split(", ") if isinstance(given, dict) and k in given}
    return shown(found if len(found) > 1 else [*found.values()][0]) if found else "nothing"


_SENTENCE = re.compile(r"(?:([^:]+): )?expected (?:(.*), found (.*)|(.*))", re.DOTALL)
_EXPECTED = {
    "model_type": "a mapping of keys to values",
    "dict_type": "a mapping of names to values",
    "tuple_type": "a list",
    "string_type": "text",
    "bool_type": "true or false",
    "int_type": "a whole number",
    "too_short": "a list of more entries,",
    "union_tag_not_found": "its `type`",
    "string_pattern_mismatch": "a name: a letter, then letters, digits and _ (lower case)",
}


def _fields(part: Any) -> Iterable[tuple[str, Any]]:
    return part.model_fields.items()  # type: ignore[no-any-return]


def _parts_at(model: Any, loc: Sequence[Any]) -> list[Any]:
    """Classes that may stand at a place of a file, found from the annotations of their fields."""
    parts = [model]
    for key in loc:
        fields = [f for k in parts for name, f in _fields(k) if key in (name, f.alias)]
        tagged = [k for k in parts if key in _tags(k)]
        parts = (
            [one for f in fields for one in _models(f.annotation)] if fields else tagged or parts
        )
    return parts


def _tags(part: Any) -> tuple[Any, ...]:
    kind = part.model_fields.get("type")
    return get_args(kind.annotation) if kind else ()


def _models(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and hasattr(annotation, "model_fields"):
        return [annotation]
    return [one for argument in get_args(annotation) for one in _models(argument)]


def lines_of(text: str, places: Iterable[str]) -> dict[str, int]:
    """Numbers of the lines of places such as "wings.0.name" in a YAML text, as far as found.

    Args:
        text: Valid YAML; empty for none.
        places: Keys and indices, joined by dots; of what is missing the part that misses it.
    """
    root = yaml.compose(text, Loader=_Loader) if text else None
    return {place: _line(root, place) for place in places if place} if root else {}


def _line(node: Any, place: str) -> int:
    line: int = node.start_mark.line
    while place:
        below = node.value if isinstance(node, yaml.MappingNode) else ()
        if isinstance(node, yaml.SequenceNode):
            below = [
                (yaml.ScalarNode("", str(i), k.start_mark), k) for i, k in enumerate(node.value)
            ]
        keys = [k for k in below if f"{place}.".startswith(f"{k[0].value}.")]
        if not keys:
            break
        key, node = keys[0]
        line, place = key.start_mark.line, place[len(str(key.value)) + 1 :]
    return line + 1
