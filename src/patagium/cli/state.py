"""State and model of a learner: resumed, and kept at the end of a verb or on Ctrl-C."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from patagium.cli.words import tell
from patagium.errors import LogError


def sole_user(file: Path | None) -> AbstractContextManager[None]:
    """Block in which no other process uses a state or a record, if a file is named.

    Raises:
        OutputError: If another process does; which one is told.
    """
    from patagium.whole_file import locked

    return nullcontext() if file is None else locked(file)


def resumed(learner: Any, state: Path | None) -> Any:
    """Learner of a state file if there is one, with a new clock; the given learner otherwise.

    Args:
        learner: New learner; the state may have other centers and scales.
        state: File; None, or a file that is not there yet: the new learner.

    Raises:
        LogError: If the file is damaged or of another learner.
    """
    if state is None or not state.exists():
        return learner
    from patagium.learning import load_learner

    found = load_learner(state, like=learner)
    found.restart_clock()
    tell(f"Going on from {state}: {found.count} samples learned before.")
    return found


def course_of(state: Path) -> Path:
    """File that keeps how far a long log was learned, next to the file of the learner's state."""
    return state.with_name(f"{state.name}.course")


def keep_state(learner: Any, state: Path | None, *, of_course: bool = False) -> None:
    """Write the state of a learner, if there is a file for it, and end its course if it has one."""
    if state is not None:
        learner.save(state)
        if of_course:  # a kill between the two costs one block, which is learned again
            from patagium.learning.long_log import remove_course

            remove_course(course_of(state))
        tell(f"The state after {learner.count} samples is in {state}")


def keep_model(
    path: Path | None, learner: Any, inputs: tuple[str, ...] | None, source: str
) -> None:
    """Write the model that a learner has learned, if there is a file for it.

    Args:
        path: File (.json), or None.
        learner: Learner, or a model.
        inputs: Names of the inputs; None: those of the network.
        source: Name of what it was learned from.

    Raises:
        LogError: If the learner has learned nothing; nothing is written then.
    """
    from patagium.learning.model_file import Model, model_of, save_model

    if path is not None:
        if not isinstance(learner, Model):
            if not learner.count:
                raise LogError(path, "samples that were learned", "none; nothing is written")
            learner = model_of(learner, inputs=inputs)
        before = instead(path)
        save_model(path, replace(learner, source=source))
        tell(f"The model is in {path}{before}")


def instead(path: Path) -> str:
    """Words for a file that is written in place of an earlier one; empty where there is none."""
    return ", in place of the one before" if path.is_file() else ""
