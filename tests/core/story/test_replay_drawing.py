"""How the replay page draws: fewer dots where frames come late, all of them at rest."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

import patagium as pt
from patagium.errors import FlightError, ParameterError
from patagium.report.replay_page import Replay, write_replay
from patagium.report.still import draw_still, solid_faces
from patagium.report.style import COLORS, SCENE, TRUTH, figures_for
from patagium.viewer import film as films
from patagium.viewer.replay import replay_content

from ...chromium import Chromium, found

SCRIPTS = files("patagium.report").joinpath("replay")


def script(name: str) -> str:
    return SCRIPTS.joinpath(name).read_text("utf-8")


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    robot = pt.load_robot("aerobat")
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    aero, start = pt.QuasiSteady(robot, pt.Air()), robot.coordinates(x=3.0)
    return pt.simulate(robot, aero, gait, duration=0.4, time_step=2e-4, v=start)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    with Chromium(tmp_path_factory.mktemp("chromium"), 500, 360) as opened:
        yield opened


def test_late_frames_cost_dots_and_quick_ones_bring_them_back(browser: Chromium) -> None:
    said = browser.ask(f"""(() => {{ {script("pace.js")}
      const pace = new Pace(), shares = [], heed = (gap, times) => {{
        for (let k = 0; k < times; k++) pace.heed(gap);
        shares.push(pace.share);
      }};
      heed(16, 50); heed(33.4, 200); heed(90, 200); heed(5000, 5); heed(12, 1500);
      const patience = pace.patience;
      heed(90, 20);
      return [shares, patience, pace.patience, COARSEST];
    }})()""")
    (quick, screen, late, hidden, again, tried), patience, longer, coarsest = said
    assert quick == screen == 1.0  # a screen that shows thirty a second is not late
    assert late == hidden == coarsest and again == 1.0
    assert tried < 1.0 and longer > patience  # finer was too much: it waits longer


def test_thinned_paths_stay_within_their_tolerance(browser: Chromium) -> None:
    t = np.linspace(0.0, 12.0, 1500)
    points = np.stack([3 * t, np.sin(9 * t), np.cos(5 * t)], axis=1)
    kept = browser.ask(f"""(() => {{ {script("paths.js")}
      return thinned(new Float32Array({json.dumps(points.ravel().tolist())}), 0.01);
    }})()""")
    assert kept[0] == 0 and kept[-1] == len(t) - 1 and len(kept) < 0.5 * len(t)
    away = max(_distance(points[a : b + 1]).max() for a, b in zip(kept, kept[1:], strict=False))
    assert 0.001 < away < 0.01 + 1e-5  # single precision of 36 m


def _distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of points from the straight line between the first and the last."""
    chord = points[-1] - points[0]
    along = chord / np.linalg.norm(chord)
    offsets = points - points[0]
    part = np.clip(offsets @ along, 0.0, np.linalg.norm(chord))
    return np.linalg.norm(offsets - part[:, None] * along, axis=1)


def test_at_rest_the_robot_is_drawn_with_all_dots(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    page = pt.replay(flight, tmp_path / "flight.html")
    browser.go(f"{page.as_uri()}#play=0&t=0.2")
    resting = """new Promise((f) => {
      const look = () => (replay.pace.atRest ? f(true) : requestAnimationFrame(look));
      look();
    })"""
    browser.ask(resting)
    dots, wide = browser.ask(
        "[(v) => v.width, (v) => v.clientWidth].map((f) => f(document.getElementById('view')))"
    )
    assert dots >= wide  # twice as many where the processor draws
    browser.ask("replay.seek(0.3)")
    browser.ask(resting)
    assert browser.ask("replay.drawn") == pytest.approx(0.3)
    browser.press("?")
    assert browser.ask("document.getElementById('keyboard').open") is True
    browser.press(" ")  # keys of the page sleep while its help is open: this closes it
    browser.ask("document.getElementById('keyboard').close()")
    assert browser.ask("replay.playing") is False
    for key, button in {"f": "forces", "o": "total", "t": "trail", "c": "follow"}.items():
        pressed = f"document.getElementById('{button}').getAttribute('aria-pressed')"
        before = browser.ask(pressed)
        browser.press(key)
        assert browser.ask(pressed) != before
    unnamed = """[...document.querySelectorAll("button, input, select, canvas, summary")].filter(
      (one) => !(one.textContent.trim() || one.title || one.labels?.length
        || one.getAttribute("aria-label") || one.getAttribute("aria-hidden"))
      ).map((one) => one.outerHTML)"""
    assert browser.ask(unnamed) == []  # each control says what it is
    browser.size(390, 700, touch=True)
    place = """(() => { const b = document.getElementById("play").getBoundingClientRect();
      return [b.left + b.width / 2, b.top + b.height / 2]; })()"""
    x, y = browser.ask(place)
    point = [{"x": x, "y": y}]
    browser.send("Input.dispatchTouchEvent", type="touchStart", touchPoints=point)
    browser.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    moving = """new Promise((f) => {
      const look = () => (replay.playing ? f(true) : requestAnimationFrame(look));
      look();
    })"""
    assert browser.ask(moving) is True  # a finger on the button
    browser.size(500, 360)
    assert browser.complaints == []


def test_words_of_an_event_are_read_on_a_phone(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    """The text of an event did not wrap, and a phone cut it at the edge of its screen."""
    words = "the robot carries 5 g more at the nose, and the left wing loses its outer third"
    told = replace(replay_content(flight), events=[(0.0, words)])
    browser.size(390, 700)
    browser.go(f"{write_replay(tmp_path / 'flight.html', told).as_uri()}#play=0")
    line = "document.getElementById('moment')"
    assert words in browser.ask(f"{line}.textContent")
    wide, room = browser.ask(f"[{line}.scrollWidth, {line}.clientWidth]")
    assert 0 < wide <= room < 390
    browser.size(500, 360)


DOTS = """(begin, end, colored) => {
  const canvas = document.querySelector(".plot").querySelectorAll("canvas")[1];
  const [from, to] = [begin, end].map((t) => 46 + (canvas.width - 54) * t / 0.4);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [to - from, canvas.height - 16];
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(canvas, -from, 0);
  const { data } = pen.getImageData(0, 0, copy.width, copy.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [red, green, blue, solid] = data.slice(i, i + 4);
    const hue = Math.max(red, green, blue) - Math.min(red, green, blue) > 80;
    if (solid > 150 && (colored ? hue : !hue && red < 110)) count++;
  }
  return count;
}"""
READ = "[...document.querySelectorAll('.plot em')].map((one) => one.textContent)"
SETTLED = "new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(() => f(0))))"


def other_values(page: Path) -> NDArray[np.float64]:
    """Values of the other flight's first curve."""
    text = page.read_text("utf-8").split('<script id="flight" type="application/json">')[1]
    words = json.loads(text.split("</script>")[0])
    raw = base64.b64decode(words["series"][0]["predicted"]["base64"])
    return np.frombuffer(raw, "<f4").astype(float)


def test_a_gap_of_a_flight_is_named_and_no_value_is_shown_there(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    """The page drew straight curves over a gap in time, showed values, and named no gap."""
    lost = flight.isel(time=np.r_[0:500, 1000:2001])
    page = pt.replay(lost, tmp_path / "lost.html")
    said = "No samples from 0.0998 to 0.2 s: there the page interpolates the pose"
    assert said in page.read_text("utf-8")
    browser.size(900, 600)
    browser.go(f"{page.as_uri()}#play=0&t=0.15")
    browser.ask(SETTLED)
    assert {*browser.ask(READ)} == {"–"}
    assert browser.ask(f"({DOTS})(0.105, 0.195, false)") == 0
    assert browser.ask(f"({DOTS})(0.21, 0.3, false)") > 50
    for t in (0.0998, 0.2, 0.4):
        browser.ask(f"replay.seek({t})")
        browser.ask(SETTLED)
        assert "–" not in browser.ask(READ)
    browser.size(500, 360)
    assert browser.complaints == []


def test_a_flight_that_ended_is_drawn_no_longer(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    """The page drew a shorter second flight, with constant values, after its end."""
    short = flight.isel(time=slice(0, 1001)).assign(aero_force=1.1 * flight["aero_force"][:1001])
    page = pt.replay(flight, tmp_path / "both.html", beside={"short": short})
    assert "short has samples from 0 to 0.2 s" in page.read_text("utf-8")
    browser.size(900, 600)
    browser.go(f"{page.as_uri()}#play=0&t=0.2")
    browser.ask(SETTLED)
    assert browser.ask("replay.other") is not None and "–" not in browser.ask(READ)
    browser.ask("replay.seek(0.3)")
    browser.ask(SETTLED)
    assert browser.ask("replay.other") is None
    assert {*browser.ask(READ)[1::2]} == {"–"} and "–" not in browser.ask(READ)[::2]
    assert browser.ask(f"({DOTS})(0.05, 0.19, true)") > 50
    assert browser.ask(f"({DOTS})(0.205, 0.4, true)") == 0
    browser.size(500, 360)
    assert browser.complaints == []


@pytest.mark.parametrize(
    ("kept", "shift", "known", "said"),
    [
        (slice(0, 1001), 0.0, [(0.0, 0.2)], "from 0 to 0.2 s; its robot is drawn at these times"),
        (slice(1000, 2001), 0.0, [(0.2, 0.4)], "from 0.2 to 0.4 s; its robot is drawn at these"),
        (slice(0, 2001), 100.0, [], "from 100 to 100.4 s; its robot is drawn at no time of this"),
        (np.r_[0:501, 1000:2001], 0.0, [(0.0, 0.1), (0.2, 0.4)], ""),
    ],
)
def test_another_flight_has_values_at_its_own_times_alone(
    kept: slice, shift: float, known: list[tuple[float, float]], said: str,
    flight: xr.Dataset, tmp_path: Path,
) -> None:  # fmt: skip
    """Values of the second flight were constant outside its time and straight over its gaps."""
    other = flight.assign(aero_force=1.1 * flight["aero_force"]).isel(time=kept)
    other = other.assign_coords(time=other["time"] + shift)
    page = pt.replay(flight, tmp_path / "both.html", beside={"other": other})
    values = other_values(page)
    time, finite = flight["time"].values, np.isfinite(values)
    inside = [[(time > a - d) & (time < b + d) for a, b in known] for d in (1e-9, 3e-4)]
    assert finite[np.any(inside[0], axis=0)].all()
    assert not finite[~np.any(inside[1], axis=0)].any()  # a step later at most
    assert ("other has samples" in page.read_text("utf-8")) is bool(said)
    assert said in page.read_text("utf-8")


def test_wing_tips_err_by_time_also_over_a_gap(
    flight: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stated error of wing tips was 2 cm instead of 0 where samples are not evenly spaced."""
    monkeypatch.setitem(replay_content.__globals__, "_BYTES", 1e5)
    steady = flight.assign(q=flight["q"][0] + 3.0 * flight["time"] * (flight["dof"] == "x"))
    steady = steady.assign(q=steady["q"].transpose("time", "dof"))
    (first, *_) = replay_content(steady.isel(time=np.r_[0:501, 1000:2001])).notes
    found = re.search(r"at most (\S+) mm. No samples from 0.1 to 0.2 s", first)
    assert found is not None and float(found[1]) < 1e-9


@pytest.mark.parametrize("size", [(500, 360), (390, 700)])
@pytest.mark.parametrize("fall", [0.0, 40.0])  # m, through a path of 1.2 m along x
def test_the_view_of_the_path_shows_all_of_it(
    fall: float, size: tuple[int, int], flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    falling = flight.copy(deep=True)
    falling["q"].loc[{"dof": "z"}] -= fall * (flight["time"] / flight["time"][-1]) ** 2
    browser.size(*size)
    browser.go(f"{pt.replay(falling, tmp_path / 'flight.html').as_uri()}#play=0")
    browser.press("5")
    for t in (0.0, 0.2, 0.4):
        browser.ask(f"replay.seek({t})")
        browser.ask(
            "new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(() => f(0))))"
        )
        tips = browser.ask("replay.marks.map((_, k) => replay.seen(k))")
        assert tips and np.abs(tips).max() < 1.0  # of half the picture
    browser.size(500, 360)


@pytest.mark.parametrize("kind", ["gif", "mp4"])
def test_a_film_has_its_pictures_and_the_robot_stays_in_them(
    flight: xr.Dataset, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(films, "PICTURES", 3)
    path, told = tmp_path / f"flight.{kind}", []
    if kind == "mp4" and find_spec("imageio_ffmpeg") is None:
        with pytest.raises(ParameterError, match=r"patagium\[film\]"):
            films.film(flight, path)
        assert not path.exists()
        return
    films.film(flight, path, start=0.1, end=0.3, progress=lambda done, total: told.append(done))
    assert told == [1, 2, 3]
    if kind == "mp4":
        assert path.read_bytes()[4:8] == b"ftyp"
        return
    with Image.open(path) as film:
        assert film.n_frames == 3 and film.info["loop"] == 0
        edge = np.array(film.convert("RGB"))[[0, -1]]
        wing = np.abs(edge.astype(int) - [159, 192, 216]).max(axis=-1) < 12
        assert not wing.any()


def test_a_page_of_another_kind_is_refused(flight: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(pt.errors.ParameterError, match=".html or .htm, found 'flight.png'"):
        pt.replay(flight, tmp_path / "flight.png")
    assert not [*tmp_path.iterdir()]


def test_a_film_of_another_kind_is_refused(flight: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="gif or"):
        films.film(flight, tmp_path / "flight.webm")


PAINTS = {
    **{"upper": "#00ff00", "lower": "#ff0000", "bodies": "#0000ff", "shadow": "#ff00ff"},
    **{"grid": "#ffff00", "gridMajor": "#ffff00", "trace": "#00ffff", "paper": "#ffffff"},
}


@pytest.fixture
def shown(flight: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> Replay:
    for part, color in PAINTS.items():
        monkeypatch.setitem(SCENE, part, color)
    return replay_content(flight)


def dots_of(figure: Figure) -> dict[str, NDArray[np.bool_]]:
    """Where a picture has the hue of each part, and where it is black."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    dots = np.asarray(canvas.buffer_rgba())[..., :3] / 255.0  # type: ignore[no-untyped-call]
    light = dots.max(axis=2)
    hues = dots / np.maximum(light, 0.1)[..., None]
    found = {
        part: (np.abs(hues - to_rgb(color)).max(axis=2) < 0.2) & (light > 0.3)
        for part, color in PAINTS.items()
    }
    return found | {"black": light < 0.2}


def test_a_still_shows_every_part_and_the_side_of_the_wing_that_is_turned_to_the_eye(
    shown: Replay,
) -> None:
    above = dots_of(draw_still(shown, 1000, seen_from=(-0.3, -0.2, 1.0)))
    below = dots_of(draw_still(shown, 1000, seen_from=(-0.3, -0.2, -1.0)))
    wide = {"upper": 0.02, "bodies": 0.01, "shadow": 0.01, "paper": 0.2}
    for part, least in {**wide, "grid": 1e-4, "trace": 5e-4, "black": 5e-4}.items():
        assert above[part].mean() > least, part  # black: arrows
    assert below["lower"].mean() > 0.02
    assert above["lower"].mean() < 1e-4 and below["upper"].mean() < 1e-4
    without = dots_of(draw_still(replace(shown, arrows=None), 1000, seen_from=(-0.3, -0.2, 1.0)))
    assert not without["black"].any()


def test_wings_of_a_still_move_and_stand_on_both_sides_of_the_body(shown: Replay) -> None:
    heights = []
    for frame in (250, 750):  # a quarter of a wingbeat is 250 samples
        dots = dots_of(draw_still(shown, frame, seen_from=(-1.0, 0.0, 0.02)))
        wing = dots["upper"] | dots["lower"]
        (row, column), middle = np.argwhere(dots["bodies"]).mean(axis=0), wing.shape[1] / 2
        assert column == pytest.approx(middle, abs=0.05 * middle)
        left, right = wing[:, : int(middle)].sum(), wing[:, int(middle) :].sum()
        assert left == pytest.approx(right, rel=0.2) and left > 100
        heights.append(row - np.argwhere(wing).mean(axis=0)[0])
    assert min(heights) < -20 < 20 < max(heights)


def test_what_is_nearer_hides_what_is_behind_it(shown: Replay) -> None:
    ball = {"kind": "ellipsoid", "body": 0, "axis": (0.0, 0.0, 1.0), "size": (0.15, 0.15, 0.15)}
    behind, front = (
        dots_of(
            draw_still(
                replace(shown, arrows=None, solids=[{**ball, "center": (at, 0.0, 0.0)}]),
                *(500,), seen_from=(-1.0, 0.0, 0.3),
            )
        )
        for at in (0.6, -0.6)
    )  # fmt: skip
    assert front["bodies"].sum() > 1.2 * behind["bodies"].sum()  # nearer and whole
    wing = [(dots["upper"] | dots["lower"]).sum() for dots in (behind, front)]
    assert wing[1] < 0.8 * wing[0]


@pytest.mark.parametrize("of_log", [False, True])
def test_a_still_shows_the_predicted_total_where_strips_are_not_predicted(
    of_log: bool, shown: Replay, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture omitted predicted forces that are known in total and not for each strip."""
    drawn: dict[str, NDArray[np.float64]] = {}
    arrows = "patagium.report.still._Layer.arrows"
    monkeypatch.setattr(
        arrows, lambda _, starts, along, color, *__, **___: drawn.update({color: along})
    )
    told = shown.arrows
    assert told is not None
    told = replace(told, **({"force": None, "point": None} if of_log else {}))
    alone = draw_still(replace(shown, arrows=told), 500)
    assert set(drawn) == {TRUTH}
    told = replace(told, predicted_total=2.0 * told.total)
    figure = draw_still(replace(shown, arrows=told), 500)
    np.testing.assert_allclose(drawn[COLORS[0]], 2.0 * drawn[TRUTH])
    np.testing.assert_allclose(np.cross(drawn[TRUTH], told.total[500]), 0.0, atol=1e-9)
    kinds = [one.texts[0].get_text().partition(":")[0] for one in (alone, figure)]
    assert kinds == ["total force" if of_log else "arrows", "predicted in color\ntotal force"]


def test_words_of_a_still_are_large_on_slides(shown: Replay) -> None:
    sizes = []
    for look in ("page", "slides"):
        with figures_for(look):
            (words,) = draw_still(shown, 500).texts
        sizes.append(words.get_fontsize())
        assert words.get_text().startswith("arrows: ") and "grid" in words.get_text()
    assert sizes == pytest.approx([9.0, 16.0], rel=0.02)


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        ("box", (0.1, 0.2, 0.3), 0.006),
        ("ellipsoid", (0.1, 0.2, 0.3), 4 / 3 * np.pi * 0.006),
        ("capsule", (0.1, 0.5), np.pi * 0.01 * (0.5 + 4 / 3 * 0.1)),
        ("cylinder", (0.1, 0.5), np.pi * 0.01 * 0.5),
    ],
)
def test_faces_of_a_solid_enclose_its_volume_and_look_outward(
    kind: str, size: tuple[float, ...], volume: float
) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    a, b, c, d = solid_faces(kind, (1.0, 2.0, 3.0), tuple(axis), size).swapaxes(0, 1)
    parts = [(np.cross(a, b) * c).sum() / 6, (np.cross(a, c) * d).sum() / 6]
    assert sum(parts) == pytest.approx(volume, rel=0.04)  # of few faces, rims rounded
    along = (np.concatenate([a, b, c, d]) - [1.0, 2.0, 3.0]) @ axis
    if kind in ("capsule", "cylinder"):
        assert np.ptp(along) == pytest.approx(0.5 + (0.2 if kind == "capsule" else 0.0))


@pytest.mark.parametrize(
    ("low", "high"),
    [(4e-6, 1.7e-5), (0.9e6, 2.3e6), (-0.022, 0.055), (-0.0095, 0.0095), (3.30e-2, 3.33e-2)],
)
def test_each_axis_has_two_labels_that_say_where_they_stand(
    low: float, high: float, browser: Chromium
) -> None:
    """A line at 1.5e-5 was labelled 1e-5, and many axes had the label 0 alone."""
    labels = browser.ask(f"""(() => {{ {script("flight.js")} {script("plots.js")}
      const labels = [], plot = {{ range: [{low}, {high}], span: [-1, 1], height: (y) => y }};
      const fillText = (text, x, y, wide) => labels.push([text, y, wide]);
      Plot.prototype.axes.call(plot, {{ fillRect: () => null, fillText }}, 46, 5, 280, 75);
      return labels;
    }})()""")
    assert not any("-" in text for text, _, _ in labels)  # the sign is a minus
    words = {text: height for text, height, wide in labels if wide == 38}  # px at the left
    said = [float(text.replace("−", "-")) for text in words]
    np.testing.assert_allclose(said, [*words.values()], rtol=1e-9, atol=1e-9 * high)  # rounding
    steps = np.diff(said)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)  # rounding
    assert 2 <= len(said) <= 5 and low <= min(said) and max(said) <= high


def small(shown: Replay, scale: float) -> Replay:
    """Replay of a robot so much smaller, of the same forces."""
    return replace(
        shown,
        origin=scale * shown.origin,
        position=scale * shown.position,
        marks=[replace(one, offset=scale * np.array(one.offset)) for one in shown.marks],
        surfaces=[replace(one, corners=scale * one.corners) for one in shown.surfaces],
        solids=[k | {n: scale * np.array(k[n]) for n in ("center", "size")} for k in shown.solids],
    )


def test_the_height_of_a_small_robot_has_its_digits(
    flight: xr.Dataset, browser: Chromium, tmp_path: Path
) -> None:
    """The height of a robot of 1 mm was 0.000 m."""
    shown = small(replay_content(flight), 0.003)
    page = write_replay(tmp_path / "small.html", shown)
    browser.go(f"{page.as_uri()}#play=0&t=0.4")
    words = browser.ask("document.getElementById('moment').textContent")
    found = re.search(r"z (\S+) m", words)
    assert found is not None and 1e-4 < abs(shown.origin[-1, 2]) < 1e-3
    said = float(found[1].replace("−", "-"))
    assert said == pytest.approx(shown.origin[-1, 2], abs=6e-7)  # m, half of the last digit


@pytest.mark.parametrize(
    ("scale", "force", "said"),
    [
        (0.005, 1e-8, r"[125]e-\d+ N = 0.[\d]+ mm · grid 0.[125] mm$"),
        (500.0, 1e6, r" [125]0+ N = [\d.]+ m · grid [125]0 m$"),
    ],
)
def test_a_still_of_a_small_or_large_robot_has_fitting_units(
    flight: xr.Dataset, scale: float, force: float, said: str
) -> None:
    """Of a robot of 1 mm it said "grid 0.02 cm", of one of 100 m "5e+05 N"."""
    shown = small(replay_content(flight), scale)
    assert shown.arrows is not None and shown.arrows.force is not None
    arrows = replace(shown.arrows, force=force * shown.arrows.force)
    (words,) = draw_still(replace(shown, arrows=arrows), 500).texts
    assert re.search(said, words.get_text()) and "e+" not in words.get_text()


def test_samples_without_motion_are_left_out(flight: xr.Dataset, tmp_path: Path) -> None:
    """One missing coordinate ended in a LinAlgError."""
    holes = flight.copy(deep=True)
    holes["q"][400:420, 3] = np.nan
    shown = replay_content(holes)
    assert len(shown.time) == flight.sizes["time"] - 20 and list(shown.gaps) == [400]
    assert "No samples from 0.0798 to 0.084 s" in shown.notes[0]
    assert draw_still(shown, 399).texts
    holes["q"][:] = np.nan
    with pytest.raises(FlightError, match="two samples with motion"):
        pt.replay(holes, tmp_path / "none.html")
