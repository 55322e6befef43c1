"""A setting is named once: a new field of the record is found wherever settings are used."""

from __future__ import annotations

import ast
import json
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import patagium
from patagium.cli.learner_options import setting_options
from patagium.learning.settings import leaves

from .source_tree import modules

SOURCE = Path(patagium.__file__).parent
DOCS = Path(__file__).parents[3] / "docs"
OLD_FIELD = "    prior_share: float = setting(\n"
NEW_FIELD = """\
    wing_beat_gain: float = setting(
        0.25,
        "Gain at each wingbeat",
        low=0.0,
        high=2.0,
        search=LogRange(0.1, 1.5),
    )
"""
PROGRAM = """
import json, sys
from pathlib import Path
from typer.main import get_command
from patagium.cli.main import app
from patagium.learning import CubatureLearner, DenseNetwork, FilterSettings
from patagium.learning.learners.registry import make_learner
from settings_table import settings_table
from patagium.learning.tuning.settings_file import LearnerSettings, NetworkSettings, Settings
from patagium.learning.tuning.settings_file import load_settings
from patagium.learning.tuning.search import search_space

verbs = get_command(app).commands
options = {
    verb: [word for one in verbs[verb].params for word in one.opts]
    for verb in ("identify", "stream", "tune", "simulate")
}
given = {"prior_std": 0.3, "measurement_std": 0.1, "wing_beat_gain": 0.75}
network = DenseNetwork(2, (3,), 2)
learner = make_learner("cubature", network, given)
file = Settings(
    every=1,
    network=NetworkSettings(kind="dense", hidden=(3,)),
    learner=LearnerSettings(**given),
).save(Path(sys.argv[1]))
print(json.dumps({
    "options": options,
    "searched": list(search_space("extended", [(3,)], [1.0], {}).distributions()),
    "described": learner.describe()["wing_beat_gain"],
    "argument": CubatureLearner(network, **given).settings.wing_beat_gain,
    "file": load_settings(file).made(network).settings.wing_beat_gain,
    "record": FilterSettings.from_description(FilterSettings(**given).describe()).wing_beat_gain,
    "table": settings_table(),
}))
"""


def test_a_setting_added_to_the_record_is_everywhere(tmp_path: Path) -> None:
    copy = tmp_path / "src" / "patagium"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    record = copy / "learning" / "settings.py"
    text = record.read_text("utf-8")
    assert text.count(OLD_FIELD) == 1
    record.write_text(text.replace(OLD_FIELD, NEW_FIELD + OLD_FIELD), "utf-8")
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "settings.yaml")]
    environment = {"PYTHONPATH": f"{tmp_path / 'src'}:{DOCS}", "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for verb, words in found["options"].items():
        assert "--wing-beat-gain" in words, verb
    assert "wing_beat_gain" in found["searched"]
    for place in ("described", "argument", "file", "record"):
        assert found[place] == 0.75, place
    row = next(line for line in found["table"].splitlines() if "`wing_beat_gain`" in line)
    assert row == (
        "| `wing_beat_gain` | Gain at each wingbeat | 1 | at least 0 and at most 2 | 0.25 "
        "| cubature, extended | 0.1 to 1.5 |"
    )


def options_of(path: Path) -> set[str]:
    """Options that a module declares: words that begin with two dashes, keywords of verbs."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "Option":
            words = [one.value for one in node.args if isinstance(one, ast.Constant)]
            found |= {str(word).lstrip("-").replace("-", "_") for word in words}
        if isinstance(node, ast.FunctionDef):
            named = (*node.args.args, *node.args.kwonlyargs)
            hints = [ast.unparse(one.annotation) for one in named if one.annotation]
            if any("typer." in hint for hint in hints):
                found |= {one.arg for one in named}
    return found


def test_no_verb_declares_an_option_of_a_setting() -> None:
    names = {word.replace("-", "_") for word, _, _ in setting_options()}
    assert {"prior_std", "noise_memory"} < names
    for path in (SOURCE / "cli").glob("*.py"):
        assert options_of(path) & names == set(), path.name


def test_no_other_module_lists_settings() -> None:
    """A dict, set, list or tuple with four settings or more would be a second registry."""
    names = {path.rpartition(".")[2] for path, _ in leaves()} | {"screening", "noise_estimation"}
    guilty = []
    for module in modules():
        if module.name == "patagium.learning.settings":
            continue
        for node in module.nodes:
            listed = getattr(node, "keys" if isinstance(node, ast.Dict) else "elts", None) or []
            words = {one.value for one in listed if isinstance(one, ast.Constant)}
            if len({word for word in words if isinstance(word, str)} & names) > 3:
                guilty.append(f"{module.name}:{node.lineno}")
    assert guilty == []


def test_the_page_of_settings_is_the_table_of_the_record() -> None:
    page = (DOCS / "settings.md").read_text("utf-8")
    table = runpy.run_path(str(DOCS / "settings_table.py"))["settings_table"]()
    assert table in page, "write what docs/settings_table.py prints into docs/settings.md"
