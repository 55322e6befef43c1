"""kill -9 while a learner is saved, at any moment: the file on disk always loads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import patagium as pt

KILLS = 20
NURSERY = """
import json, os, signal, sys, time
import numpy as np
import patagium as pt

path, kills = sys.argv[1], int(sys.argv[2])
wait, rounds = np.random.default_rng(3), []
for _ in range(kills):
    learner, (listen, speak) = pt.load_learner(path), os.pipe()
    child = os.fork()
    if child == 0:
        draw = np.random.default_rng()
        while True:
            learner.update(draw.normal(size=6), draw.normal(size=2))
            learner.save(path)
            os.write(speak, b"%d " % learner.count)
    os.close(speak)
    time.sleep(float(wait.uniform(0, 0.1)))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(listen, "rb") as said:
        counts = said.read().split()
    last = int(counts[-1]) if counts else learner.count
    rounds.append([learner.count, last, pt.load_learner(path).count])
print(json.dumps(rounds))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_learner_killed_while_saving_is_never_lost(tmp_path: Path) -> None:
    network = pt.DenseNetwork(6, (60, 60), 2)
    learner = pt.ExtendedLearner(network, covariance="node")  # learns fast, saves for long
    path = learner.save(tmp_path / "learner.state")
    command = [sys.executable, "-c", NURSERY, str(path), str(KILLS)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rounds = json.loads(done.stdout)
    assert len(rounds) == KILLS and rounds[-1][2] > 0, "no child lived long enough to save"
    for begun, said, found in rounds:
        assert begun <= said <= found <= said + 1  # what was said to be saved, or one more
