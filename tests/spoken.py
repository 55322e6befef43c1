"""Words said to the program, as a person says them at a terminal."""

from __future__ import annotations

from collections.abc import Callable
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
