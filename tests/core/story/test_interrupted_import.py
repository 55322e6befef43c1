"""Ctrl-C while a log is imported: nothing half-written, and the same command goes on."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from patagium.cli.main import run
from patagium.sensing.logs.files import csv_file
from patagium.sensing.logs.importing import spool
from patagium.sensing.logs.record import LogRecord


def say(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        run([str(word) for word in words])
    return int(str(left.value.code or 0))


def test_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(csv_file, "BLOCK", 100)
    monkeypatch.setattr(spool, "_PERIOD", 0.0)
    time = 1e-3 * np.arange(1000)
    pd.DataFrame({"t": time, "lift": np.sin(time)}).to_csv("log.csv", index=False)
    Path("map.yaml").write_text("time: {column: t}\nchannels: [{column: lift, unit: N}]\n")
    written = spool.Spool._write_journal

    def pressed(self: Any, files: Any) -> None:
        written(self, files)
        if sum(self.consumed) == 400:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(spool.Spool, "_write_journal", pressed)
        assert say("import", "log.csv", "--map", "map.yaml") == 130
    assert "the same command goes on from here" in capsys.readouterr().err
    assert not Path("log.nc").exists() and Path(".log.nc.import").is_dir()
    assert say("import", "log.csv", "--map", "map.yaml") == 0
    assert "Went on from 400 rows read before." in capsys.readouterr().out
    assert not Path(".log.nc.import").exists()
    with LogRecord("log.nc") as record:
        np.testing.assert_array_equal(record.values(("lift",))[:, 0], np.sin(time))
