"""Pieces of work in processes: their order, what waits for what, and what goes wrong."""

import operator
import os

import pytest

from patagium_lab.jobs import Job, by_urgency, run_jobs


def test_the_longest_line_of_work_comes_first():
    jobs = [
        Job(len, ("a",), 1.0),
        Job(len, ("b",), 2.0),
        Job(len, ("c",), 3.0, (0,)),
        Job(len, ("d",), 5.0),
        Job(len, ("e",), 2.5, (2,)),
    ]
    assert by_urgency(jobs) == [0, 2, 3, 4, 1]
    jobs.append(Job(len, ("f",), 0.1, (1,), urgent=True))
    assert by_urgency(jobs) == [1, 5, 0, 2, 3, 4]


def test_a_job_waits_for_those_before_it(tmp_path):
    folder, inner = tmp_path / "a", tmp_path / "a" / "b"
    told = []
    jobs = [
        Job(os.mkdir, (folder,), 1.0),
        Job(os.mkdir, (inner,), 50.0, (0,)),
        Job(os.listdir, (folder,), 100.0, (0, 1)),
        Job(operator.add, (2, 3), 10.0),
    ]
    done = []
    found = run_jobs(jobs, told.append, done_one=lambda place, result: done.append((place, result)))
    assert found == [None, None, ["b"], 5] == [result for _, result in sorted(done)]
    assert told == sorted(told) and told[-1] == pytest.approx(1.0)
    with pytest.raises(FileExistsError):
        run_jobs(jobs[:2], workers=1)
