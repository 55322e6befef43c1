"""The wheel flies without the checkout, and its description has no dead link."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="hatchling is not installed: pip install 'patagium[dev]'")
ROOT = Path(__file__).parents[3]
LINK = re.compile(r"\]\(([^)]+)\)")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the unpacked files of the wheel."""
    from hatchling.builders.wheel import WheelBuilder

    folder = tmp_path_factory.mktemp("wheel")
    (built,) = WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    with zipfile.ZipFile(built) as packed:
        packed.extractall(folder / "content")
    return folder / "content"


def test_it_flies_in_an_environment_that_has_its_requirements_alone(
    wheel: Path, tmp_path: Path
) -> None:
    others = tmp_path / "others"
    others.mkdir()
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if "patagium" not in entry.name and entry.suffix != ".pth":
            (others / entry.name).symlink_to(entry)
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(tmp_path),
        "PYTHONPATH": os.pathsep.join(map(str, (wheel, others))),
    }
    program = """
import patagium
from patagium.cli.main import run
for words in (["simulate", "aerobat", "--duration", "0.3"], ["cycles", "flight.nc"]):
    print(patagium.__file__)
    try:
        run(words)
    except SystemExit as end:
        assert not end.code, words
"""
    command = [sys.executable, "-S", "-c", program]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(wheel)) and done.stdout.count("Next: patagium") == 2
    assert (tmp_path / "flight.nc").stat().st_size > 1_000


def test_its_description_has_no_link_that_an_index_cannot_follow(wheel: Path) -> None:
    (metadata,) = wheel.glob("*.dist-info/METADATA")
    told = metadata.read_text("utf-8").partition("\n# patagium\n")[2]
    assert "\n## The first flight\n" in told
    assert [place for place in LINK.findall(told) if not re.match("https?:", place)] == []


def test_links_and_pictures_become_absolute_where_the_project_has_an_address() -> None:
    spec = spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None and spec.loader is not None
    program = module_from_spec(spec)
    spec.loader.exec_module(program)
    text = (ROOT / "README.md").read_text("utf-8")
    told = program.described(text, "https://example.org/patagium/")
    places = LINK.findall(told)
    assert places and all(one.startswith("https://example.org/patagium/") for one in places)
    files = [re.sub("^.*?/(raw|blob)/HEAD/", "", one) for one in places]
    assert files == LINK.findall(text) and all((ROOT / one).is_file() for one in files)
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", told)
    assert pictures and all("/raw/HEAD/" in one for one in pictures)
