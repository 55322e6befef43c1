"""Whatever is in a robot file, the answer is a robot or a RobotFileError."""

import random

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from patagium.errors import RobotFileError
from patagium.robot import Robot, load_robot_text, preset_names, preset_text

ODD = (
    None, True, -1, 0, 10**400, float("nan"), "", "1e999", "5 bananas", "3 m^9", "2026-13-40",
    [], {}, [[]], {"a": 1}, ["x"] * 3, "left_plate", {1: 2}, [None] * 3, "\x00", "é",
)  # fmt: skip


def _answer(text: str) -> None:
    try:
        assert isinstance(load_robot_text(text, "broken.yaml"), Robot)
    except RobotFileError as error:
        assert error.problems
        assert "broken.yaml" in str(error)


def _places(node: object, path: tuple[object, ...] = ()) -> list[tuple[object, ...]]:
    below = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    return [path, *(place for key, value in below for place in _places(value, (*path, key)))]


def _change(node: object, path: tuple[object, ...], rng: random.Random) -> object:
    if not path:
        return rng.choice(ODD)
    holder = node
    for key in path[:-1]:
        holder = holder[key]
    action = rng.choice(("replace", "replace", "remove", "add"))
    if action == "remove":
        del holder[path[-1]]
    elif action == "add" and isinstance(holder, dict):
        holder[rng.choice(("extra", 7, None, True))] = rng.choice(ODD)
    else:
        holder[path[-1]] = rng.choice(ODD)
    return node


@pytest.mark.parametrize("seed", range(60))
def test_a_file_with_odd_values_is_answered(seed):
    rng = random.Random(seed)
    described = yaml.safe_load(preset_text(rng.choice(preset_names())))
    for _ in range(rng.choice((1, 1, 3))):
        described = _change(described, rng.choice(_places(described)), rng)
    _answer(yaml.dump(described, allow_unicode=True))


@pytest.mark.parametrize("seed", range(40))
def test_a_file_with_broken_characters_is_answered(seed):
    rng = random.Random(seed)
    text = list(preset_text(rng.choice(preset_names())))
    for _ in range(rng.choice((1, 2, 5, 20))):
        place = rng.randrange(len(text))
        text[place] = rng.choice((*"{}[]:,-&*!|>%@`\"'#\t\n 0", "", "é", "\x07", "e9999", "? "))
    _answer("".join(text))


@given(st.text(max_size=60))
def test_any_text_is_answered(text):
    _answer(text)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 3000,
        "{a: " * 3000,
        "- " * 3000,
        "&a [*a]",
        "!!python/object/apply:os.system [true]",
        "? [a]\n: b",
        "? {a: b}\n: c",
        "!!binary x",
        "!!set {a, b}",
        "!!int ''",
        "!!float 'x'",
        "!!bool x",
        "!!timestamp x",
        "a: 2026-99-99",
        "--- a\n--- b",
        "<<: 5",
        "name: " + "9" * 5000,
    ],
)
def test_yaml_that_is_more_than_a_mapping_is_answered(text):
    _answer(text)
