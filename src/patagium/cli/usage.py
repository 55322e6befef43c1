"""Wrong words on the command line as one sentence: expected, found, what to type."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import typer

from patagium.errors import shown, similar

UsageError: Any = typer.BadParameter.__base__
"""Error of typer for words that are no use of the program."""

_CHOICE = re.compile(r"(?:Value error, )?'(.*)' is not one of (.*?)\.?")


def usage_sentence(error: Any, words: Sequence[str]) -> str:
    """Sentence for a usage error."""
    verb = " ".join(("patagium", *words[: 2 if words[0] == "study" else 1]))
    if error.ctx is None:  # a flag with `=`, or the last word is an option without its value
        given = "a value, found nothing"
        if "not take" in error.message:
            given = "no value, found one"
        return f"{error.option_name}: expected {given}; see {verb} --help"
    verb, command = error.ctx.command_path, error.ctx.command
    if hasattr(error, "option_name") and hasattr(error, "possibilities"):
        options = [name for one in command.params for name in one.opts]
        found = f"{error.option_name!r}{similar(error.option_name, options)}"
        return f"expected one of the options that {verb} --help lists, found {found}"
    verbs = getattr(command, "commands", None)
    if verbs is not None:
        known = [name for name, one in verbs.items() if not one.hidden]
        word = next((k for k in words if not k.startswith("-") and k != command.name), "nothing")
        found = f"{word!r}{similar(word, known)}"
        return f"expected one of the verbs that {verb} --help lists, found {found}"
    parameter = getattr(error, "param", None)
    if parameter is None:
        beyond = error.message.rpartition("(")[2].removesuffix(")")
        place = max(i for i, word in enumerate(words) if f"{beyond} ".startswith(f"{word} "))
        former, found = words[place - 1], f"found {words[place]!r}; see {verb} --help"
        told = f"expected nothing after {former!r}"
        if former.startswith("-"):
            told = f"{former}: expected no value"
        return f"{told}, {found}"
    option = parameter.opts[0] if parameter.opts[0].startswith("-") else parameter.name
    if hasattr(error, "param_type"):
        example = next(iter(re.findall(r"patagium .*", command.epilog or "")), f"{verb} --help")
        return f"{option}: expected a value, found nothing; type such as: {example}"
    said = error.message.removeprefix(f"{parameter.name}: ").removeprefix("Value error, ")
    choice = _CHOICE.fullmatch(said)
    if choice:
        known = choice[2].replace("'", "").split(", ")
        found = f"{choice[1]!r}{similar(choice[1], known)}"
        return f"{option}: expected one of {', '.join(known)}, found {found}"
    if said.startswith("Input should be "):
        at = [i for i, word in enumerate(words[:-1]) if word in parameter.opts]
        found = f", found {shown(words[at[-1] + 1])}" if at else ""
        wanted = f"a value {said.removeprefix('Input should be ')}"
        if "a valid number" in said or "a valid integer" in said:
            wanted = f"a {'whole ' if 'integer' in said else ''}number such as 1"
        return f"{option}: expected {wanted}{found}"
    return f"{option}: {said}"
