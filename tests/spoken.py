"""Words said to the program, as a person says them at a terminal."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import NamedTuple

import pytest

from patagium.cli.main import run


class Answer(NamedTuple):
    code: int
    out: str
    err: str


Speak = Callable[..., Answer]


def say(capsys: pytest.CaptureFixture[str], *words: object) -> Answer:
    """Exit code, answer and complaints of the program."""
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    said = capsys.readouterr()
    code = left.value.code
    return Answer(code if isinstance(code, int) else 0, said.out, said.err)


@contextmanager
def refusing_stdout(*, pipe: bool) -> Iterator[None]:
    """Standard output into a pipe whose reader has gone, or onto a disk without space."""
    place: int | str = "/dev/full"
    if pipe:
        reader, place = os.pipe()
        os.close(reader)
    stream = open(place, "w", encoding="utf-8")
    try:
        with redirect_stdout(stream):
            yield
    finally:
        with suppress(OSError):
            stream.close()
