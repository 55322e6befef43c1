"""Imports that are interrupted or killed leave nothing half-written, and say what to do."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from patagium.cli.main import run
from patagium.sensing.logs.importing.resample import Spool
from patagium.sensing.logs.record import LogRecord


def say(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    return int(str(left.value.code or 0))


def written(rows: int) -> None:
    clock = 1e-3 * np.arange(rows)
    pd.DataFrame({"t": clock, "lift": np.sin(clock)}).to_csv("log.csv", index=False)
    Path("map.yaml").write_text("time: {column: t}\nchannels: [{column: lift, unit: N}]\n")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("stage", ["_keep", "values_of"])
def test_the_same_command_begins_again(
    stage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(1000)
    before = names(tmp_path)

    def pressed(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Spool, stage, pressed)
        assert say("import", "log.csv", "--map", "map.yaml") == 130
    assert "log.nc is as it was before; repeat the command" in capsys.readouterr().err
    assert names(tmp_path) == before
    assert say("import", "log.csv", "--map", "map.yaml") == 0
    assert names(tmp_path) == sorted([*before, "log.nc"])
    with LogRecord("log.nc") as record:
        expected = np.sin(1e-3 * np.arange(1000))
        np.testing.assert_array_equal(record.values(("lift",))[:, 0], expected)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_kill_while_rows_are_read_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(1000)
    before = names(tmp_path)
    program = """
import sys, time
from patagium.cli.main import run
from patagium.sensing.logs.importing.resample import Spool
def read(self, block, advances):
    print("reading", flush=True)
    time.sleep(60)
Spool._keep = read
run(["import", "log.csv", "--map", "map.yaml"])
"""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as child:
        assert child.stdout is not None and child.stdout.readline() == "reading\n"
        child.send_signal(signal.SIGKILL)
        child.wait(timeout=30)
    assert names(tmp_path) == before
