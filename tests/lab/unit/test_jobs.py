"""Pieces of work in processes: their order, what waits for what, and what goes wrong."""

import operator
import os
import signal
import subprocess
import sys
from multiprocessing import active_children
from subprocess import PIPE

import pytest

from patagium.errors import PatagiumError
from patagium_lab.jobs import Job, by_urgency, run_jobs

STUDY = """
import signal, sys, time
from patagium.errors import PatagiumError
from patagium_lab.jobs import Job, run_jobs

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # tests may run where it is ignored
    jobs = [Job(len, ("a",), 1.0), Job(time.sleep, (60,), 1.0)]
    try:
        run_jobs(jobs, lambda share: print(share, flush=True))
    except KeyboardInterrupt:
        sys.exit(130)
"""


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


def test_an_interrupt_waits_for_no_job_that_runs(tmp_path):
    late = tmp_path / "late"
    slow = Job(subprocess.run, (["sh", "-c", f"sleep 3; touch {late}"],), 1.0)
    after = Job(len, ("b",), 1.0, after=(1,))

    def stop(share):
        raise KeyboardInterrupt

    others = set(active_children())  # joblib's workers outlive the tests that asked for them
    with pytest.raises(KeyboardInterrupt):
        run_jobs([Job(len, ("a",), 2.0), slow, after], stop)
    assert not late.exists() and set(active_children()) <= others


def test_ctrl_c_at_a_terminal_ends_jobs_without_a_word_of_theirs(tmp_path):
    script = tmp_path / "study.py"
    script.write_text(STUDY)
    study = subprocess.Popen(
        [sys.executable, script], stdout=PIPE, stderr=PIPE, text=True, start_new_session=True
    )
    assert study.stdout is not None and study.stdout.readline() == "0.5\n"
    os.killpg(study.pid, signal.SIGINT)
    said = study.communicate(timeout=60)
    assert study.returncode == 130 and said == ("", "")


def test_a_job_whose_process_dies_is_an_error_with_its_exit_code():
    others = set(active_children())
    with pytest.raises(PatagiumError, match="exit code 3 before its job"):
        run_jobs([Job(len, ("a",), 1.0), Job(os._exit, (3,), 1.0)])
    assert set(active_children()) <= others


def test_an_error_of_a_job_tells_where_it_came_from():
    with pytest.raises(ZeroDivisionError) as found:
        run_jobs([Job(divmod, (1, 0), 1.0)], workers=1)
    assert "in _serve" in found.value.__notes__[0]
