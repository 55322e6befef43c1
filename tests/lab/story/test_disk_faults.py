"""A disk that fails at any write: old files stay, drafts go, an error says where and what to do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from patagium_lab.attack.disk_faults import KINDS, injector

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs LD_PRELOAD")

NURSERY = """
import gc, json, sys
from pathlib import Path
import numpy as np, pandas as pd, xarray as xr
import patagium as pt
from matplotlib.figure import Figure
from patagium.learning.model_file import save_model
from patagium.learning.learners.state_file import write_state
from patagium.netcdf_file import write_netcdf
from patagium.report import PageSection, Note, write_page
from patagium.report.figures import save_figure
from patagium.sensing.logs.importing.import_log import import_log
from patagium.sensing.logs.mapping import parse_mapping
from patagium_lab.attack.disk_faults import KINDS, forked_with_fault

folder, source = Path(sys.argv[1]), Path(sys.argv[2])
record = xr.Dataset({"x": ("time", np.arange(1e4))}, attrs={"words": "x" * 1000})
network = pt.DenseNetwork(2, (3,), 1)
learner = pt.CubatureLearner(network, prior_std=1.0, measurement_std=0.1)
figure = Figure()
figure.add_subplot().plot([0, 1])
time = np.arange(0.0, 1.0, 1e-3)
pd.DataFrame({"t": time, "x": time, "y": time**2}).to_csv(source / "log.csv", index=False)
words = {
    "time": {"column": "t", "unit": "s"},
    "inputs": [{"name": "x", "column": "x", "unit": "m"}],
    "outputs": [{"name": "y", "column": "y", "unit": "N"}],
}
mapping = parse_mapping(words)

actions = {
    "f.nc": lambda: write_netcdf(folder / "f.nc", record, {"inner": record}),
    "f.state": lambda: learner.save(folder / "f.state"),
    "f.json": lambda: save_model(folder / "f.json", learner),
    "f.svg": lambda: save_figure(figure, folder / "f.svg"),
    "log.nc": lambda: import_log(source / "log.csv", mapping, folder / "log.nc"),
    "log.csv": lambda: import_log(source / "log.csv", mapping, folder / "log.csv"),
}
rows = []
gc.collect()
gc.freeze()  # what the forks inherit is not looked through again
for name, action in actions.items():
    def whole(action=action):
        action()
        gc.collect()
    whole_run = forked_with_fault(whole, folder, None)
    assert whole_run.code == 0, whole_run.errors
    count = whole_run.operations
    points = sorted({0, 2, count // 3, count // 2, count - 3, count - 2, count - 1})
    for kind in KINDS if name == "f.nc" else KINDS[:1]:
        for nth in points:
            (folder / name).write_text("old")
            run = forked_with_fault(whole, folder, nth, kind)
            left = sorted(one.name for one in folder.iterdir() if one.name != name)
            old = (folder / name).read_bytes() == b"old"
            last = run.errors.strip().splitlines()[-1:]
            rows.append([name, kind, nth, count, run.code, last, left, old])
            for one in folder.iterdir():
                one.unlink()
print(json.dumps(rows))
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> list[list[Any]]:
    """Result of every writer at many writes that fail."""
    aside, memory = tmp_path_factory.mktemp("aside"), Path("/dev/shm")  # forcing is free there
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else aside) as folder:
        done = subprocess.run(
            [sys.executable, "-c", NURSERY, folder, str(aside)],
            env={**os.environ, "LD_PRELOAD": str(injector(aside))},
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    rows: list[list[Any]] = json.loads(done.stdout)
    return rows


def test_every_writer_survives_a_fault_at_any_write(swept: list[list[Any]]) -> None:
    assert {row[1] for row in swept} == set(KINDS)
    for name, kind, nth, count, code, last, left, old in swept:
        case = f"{name}, {kind}, operation {nth} of {count}: {code}, {last}"
        assert count >= 5, case
        assert left == [], f"{case}: left behind {left}"
        assert code in (0, 1), f"{case}: ended by a signal"
        if code:
            assert "OutputError: " in last[0] and "cannot be written" in last[0], case
            assert last[0].count(";") >= 1, f"{case}: no remedy"
            assert old, f"{case}: the old file is lost"
        else:
            assert not old, f"{case}: nothing was written, and nothing said so"


def test_the_faults_are_met(swept: list[list[Any]]) -> None:
    failed = [row for row in swept if row[4]]
    assert len(failed) > len(swept) / 2
    assert {row[0] for row in failed} == {row[0] for row in swept}
