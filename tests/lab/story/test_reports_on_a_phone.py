"""Reports in a browser, on a screen of 1400 pixels and a phone of 390.

Screenshots are written to $PATAGIUM_ARTEFACTS, or the test's own folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from shutil import copyfile

import pytest

from patagium.cli.main import run

from ...chromium import Chromium, found

SCREENS = {"screen": (1400, 900), "phone": (390, 844)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a flight, the report of what was learned from it, and its figures."""
    if found() is None:
        pytest.skip("no Chromium on this machine")
    out = tmp_path_factory.mktemp("report")
    flight = str(out / "flight.nc")
    for words in (
        ["simulate", "aerobat", "--duration", "0.5", "-o", flight],
        ["identify", flight, "--report", str(out / "report.html"), "--model", str(out / "m.json")],
        [
            "figures",
            flight,
            "--model",
            str(out / "m.json"),
            "--format",
            "png",
            "--output",
            str(out / "figures"),
        ],
    ):
        with pytest.raises(SystemExit) as left:
            run(words)
        assert not left.value.code
    return out


@pytest.fixture(scope="module")
def browser(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium"), *SCREENS["screen"]) as opened:
        yield opened


@pytest.mark.parametrize("screen", SCREENS)
def test_the_report_of_an_identification_fits(
    folder: Path, browser: Chromium, screen: str, tmp_path: Path
) -> None:
    width, height = SCREENS[screen]
    browser.size(width, height, touch=screen == "phone")
    browser.go((folder / "report.html").as_uri())
    artefacts = Path(os.environ.get("PATAGIUM_ARTEFACTS", tmp_path))
    artefacts.mkdir(parents=True, exist_ok=True)
    browser.screenshot(artefacts / f"identification-{screen}.png")
    copyfile(folder / "figures" / "flight.png", artefacts / "figures-flight.png")
    first = browser.ask("document.querySelector('header').innerText")
    assert "Intervals" in first and "NIS" in first and "Right: 95 %" in first
    assert browser.ask("document.querySelectorAll('header img').length") == 2
    assert browser.ask("[...document.querySelectorAll('details')].every((one) => !one.open)")
    assert browser.ask("document.documentElement.scrollHeight") < 3 * height
    assert browser.misfits() == []
