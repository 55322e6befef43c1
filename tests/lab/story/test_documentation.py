"""What the documentation shows, runs: every block of code, every name, every link, the build."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.cli.plan import load_plan
from patagium.sensing.logs.files import opening

from ...chromium import Chromium, found

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHORTER = {
    "duration=2.0": "duration=0.4",
    "duration=0.5": "duration=0.1",
    "duration=1.0, time_step=5e-4": "duration=0.5, time_step=5e-4",
    "600 * law.period": "120 * law.period",
    "200 * controller.period": "60 * controller.period",
    "ticks=600": "ticks=30",
    "beats=20": "beats=5",
    '"2 s"': '"0.2 s"',
    "every=100": "every=10",
    "--every 100": "--every 10",
    "trials=64": "trials=8",
    "--trials 64": "--trials 8",
    "--along speed=2.5:6": "--along speed=3.95:4.05",
    '--speed "4 m/s" -o best.nc': '--speed "4 m/s" --harmonics 1 -o best.nc',
    "--front 4,5,6": "--front 4 --harmonics 2",
}
FEW_STATES = re.compile(r"(air|calibrate|choose|gallery|robot_file|api/\w+)\.md")
"""Pages that fly so briefly that their equations take longer to compile than to interpret."""


def _texts() -> dict[str, str]:
    """The pages, by their place in the documentation."""
    return {str(p.relative_to(DOCS)): p.read_text("utf-8") for p in sorted(DOCS.rglob("*.md"))}


def _pages() -> list[str]:
    return [page for page, text in _texts().items() if BLOCK.search(text)]


def _shortened(text: str) -> str:
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return text


def _write_capture(path: Path) -> None:
    """A bag of motion capture as a laboratory records it, with tumbles and swapped markers."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    from patagium_lab.attack.motion_capture import captured

    kind = "geometry_msgs/msg/PoseStamped"
    types = get_typestore(Stores.ROS1_NOETIC)
    make = types.types
    log, _ = captured(13)
    reading = log["cameras"]
    with Writer(path) as writer:
        connection = writer.add_connection("/mocap/brick", kind, typestore=types)
        parts = [reading[name].values for name in ("time", "position", "quaternion")]
        for time, place, (w, x, y, z) in zip(*parts, strict=True):
            stamp = round((1e9 + time) * 1e9)
            when = make["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            pose = make["geometry_msgs/msg/Pose"](
                position=make["geometry_msgs/msg/Point"](*map(float, place)),
                orientation=make["geometry_msgs/msg/Quaternion"](*map(float, (x, y, z, w))),
            )
            header = make["std_msgs/msg/Header"](seq=0, stamp=when, frame_id="world")
            message = make[kind](header=header, pose=pose)
            writer.write(connection, stamp, types.serialize_ros1(message, kind))


def _said(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    program, *words = shlex.split(line)
    assert program == "patagium"
    with pytest.raises(SystemExit) as left:
        run(words)
    assert left.value.code == 0, line + capsys.readouterr().err


def _stage(page: str) -> dict[str, Any]:
    """What a page takes for granted: it tells what comes from the reader's own machine."""
    if page == "logs.md":
        _write_capture(Path("flight.bag"))
    if page == "plant.md":
        pytest.importorskip("mujoco", reason="MuJoCo comes with the extra `bench`")
    if page != "stream.md":
        return {}
    seconds = iter([0.0, 1e-3])
    still, columns = np.zeros(14), 1 + 4 * 14
    packets = np.zeros((3, columns))
    packets[:, 0] = [0.0, 1e-3, 2e-3]
    left = iter([True, True, False])
    return {
        "flying": lambda: next(left),
        "clock": lambda: next(seconds),
        "packets": packets[:2],
        "packet": packets[2],
        **{name: (lambda: still) for name in ("q", "v", "a", "u1")},
    }


def test_every_code_block_has_a_known_language() -> None:
    """Only blocks marked python and sh are run; an unknown mark would leave code untested."""
    for page, text in {**_texts(), "README.md": (ROOT / "README.md").read_text("utf-8")}.items():
        opening_fences = re.findall(r"^ *```(.*)$", text, re.MULTILINE)[::2]
        assert {*opening_fences} <= {"python", "sh", "text", "yaml", "{eval-rst}", "{toctree}"}, (
            page
        )


@pytest.mark.filterwarnings("default:LinearRegulator")  # as control.md shows it
@pytest.mark.parametrize("page", _pages())
def test_blocks_of_a_page_run_one_after_the_other(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    if FEW_STATES.fullmatch(page):
        request.getfixturevalue("interpreted")
    monkeypatch.setattr(opening, "_SINGLE", dict(opening._SINGLE))  # pages may register readers
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__", **_stage(page)}
    for language, block in BLOCK.findall((DOCS / page).read_text("utf-8")):
        if language == "python":
            exec(compile(_shortened(block), page, "exec", dont_inherit=True), names)
        else:
            for line in filter(None, _shortened(block).splitlines()):
                _said(line, capsys)


def test_an_own_ornithopter_takes_sixty_lines_and_six_commands() -> None:
    text = (DOCS / "robot_file.md").read_text("utf-8")
    section = text[text.index("## Your own ornithopter") :].partition("\n## What there is")[0]
    blocks = BLOCK.findall(section)
    typed = [line for _, block in blocks for line in block.splitlines() if line.strip()]
    commands = [line for line in typed if line.startswith("patagium ")]
    assert [line.split()[1] for line in commands] == [
        "robots", "check", "simulate", "identify", "view",
    ]  # fmt: skip
    assert len(typed) <= 60 and len(commands) <= 6


def _said_names(code: str) -> set[str]:
    """Dotted names of patagium that code says, such as `sensors.presets.as5600`."""
    tree, known = ast.parse(code), dict[str, str]()

    def dotted(node: ast.expr) -> str | None:
        if isinstance(node, ast.Attribute):
            before = dotted(node.value)
            return None if before is None else f"{before}.{node.attr}".removeprefix(".")
        return known.get(node.id) if isinstance(node, ast.Name) else None

    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            known |= {a.asname: "" for a in node.names if a.name == "patagium" and a.asname}
    for node in ast.walk(tree):  # parts = pt.sensors.presets
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            module = dotted(node.value)
            if module and isinstance(_object(module), ModuleType):
                known[node.targets[0].id] = module
    found = (dotted(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute))
    return {name for name in found if name}


def _object(name: str) -> Any:
    value: Any = pt
    for part in name.split("."):
        value = getattr(value, part, None)
    return value


NAME_SPACES = ("air", "errors", "learning", "sensing")
IN_NAME_SPACES = {
    "air": """DrydenGust Indicial OneMinusCosineGust RampGust Section StallDelay TablePolar
        TravelingGust measured_section""",
    "errors": """CompilerError FilterDiverged FlightError LogError Outcome ParameterError PathError
        RobotFileError RobotFileWarning ShapeError SimulationFailed""",
    "learning": "ChangeDetection NoiseEstimation Screening",
    "sensing": """ForceSamples MotionTracker SensorLog
        cell_wrench estimate_shifts inspect_log load_cell_force load_sensor_log
        motor_forces save_sensor_log""",
}
"""Names of the name spaces that a user meets first."""


def _top_names() -> set[str]:
    """Names of `pt`, and those of its name spaces that a user meets first."""
    names = {*pt.__all__} - {"__version__", *NAME_SPACES}
    spaces = IN_NAME_SPACES.items()
    return names | {f"{space}.{name}" for space, words in spaces for name in words.split()}


def _public_names() -> set[str]:
    names = _top_names()
    short = {name.split(".")[-1] for name in names}
    for module in ("gaits", "mounts", "paths", "sensors", "sensors.presets"):
        names |= {f"{module}.{name}" for name in _object(module).__all__ if name not in short}
    return names


def _unspaced(name: str) -> str:
    """Name without its name space: `air.QuasiSteady` is also `QuasiSteady`."""
    space, _, rest = name.partition(".")
    return rest if space in NAME_SPACES and rest in pt.__all__ else name


def test_shapes_and_the_plan_of_the_pages_are_read(tmp_path: Path) -> None:
    shapes = re.findall(r"^\| `(\{type: .*\})` \|", _texts()["robot_file.md"], re.MULTILINE)
    assert len(shapes) == 5
    path = tmp_path / "one.yaml"
    for one in shapes:
        body = f"{{floating: true, mass: 1 g, shape: {one}}}"
        path.write_text(f"name: one\ngravity: 9.81\nbodies: {{b: {body}}}", encoding="utf-8")
        if "point" not in one:  # nothing that turns may be without inertia
            assert pt.load_robot(path).bodies[0].mass == 0.001
    plan = re.search(r"```yaml\n(robot: ornithopter\n.*?)```", _texts()["control.md"], re.DOTALL)
    assert plan is not None
    path.write_text(plan[1], encoding="utf-8")
    assert load_plan(path).sensors.std["z"] == 0.002


def test_every_public_name_has_an_example_or_is_given_by_one() -> None:
    """Said in a block of code that runs, or the type that something said there returns."""
    readme = (ROOT / "README.md").read_text("utf-8")
    said: set[str] = set()
    for text in (readme, *_texts().values()):
        blocks = [block for language, block in BLOCK.findall(text) if language == "python"]
        said |= _said_names("\n".join(blocks))
    said = {_unspaced(name) for name in said}
    values = [_object(name) for name in said]
    types = [inspect.signature(f).return_annotation for f in values if inspect.isfunction(f)]
    given = {word for kind in types for word in re.findall(r"\w+", str(kind))}
    assert {name for name in _public_names() - said if name.split(".")[-1] not in given} == set()


def test_every_public_name_is_on_a_page_of_names() -> None:
    pages = "\n".join(text for page, text in _texts().items() if page.startswith("api/"))
    shown = re.findall(r"^\.\. auto\w+:: patagium\.(?:\w+\.)*(\w+)$", pages, re.MULTILINE)
    spaces = {name for space in (*NAME_SPACES, "control") for name in _object(space).__all__}
    assert {name.split(".")[-1] for name in {*_top_names(), *spaces}} - {*shown} == set()
    assert len(shown) == len({*shown})


def test_extensions_are_short_and_use_public_names_alone() -> None:
    sections = re.split(r"^## ", (DOCS / "extend.md").read_text("utf-8"), flags=re.MULTILINE)[1:]
    assert len(sections) >= 4
    for section in sections:
        code = [block for language, block in BLOCK.findall(section) if language == "python"]
        lines = [line for block in code for line in block.splitlines() if line.strip()]
        assert 0 < len(lines) < 40, section.splitlines()[0]
        private = re.findall(r"\b_[a-z]\w*|\._[a-z]\w*", "\n".join(code))
        assert private == [], section.splitlines()[0]


def test_the_picture_of_the_architecture_is_the_drawn_one(tmp_path: Path) -> None:
    spec = spec_from_file_location("draw_architecture", DOCS / "draw_architecture.py")
    assert spec is not None and spec.loader is not None
    program = module_from_spec(spec)
    sys.modules[spec.name] = program
    spec.loader.exec_module(program)
    drawn = program.write(tmp_path / "architecture.svg").read_text("utf-8")
    assert (DOCS / "architecture.svg").read_text("utf-8") == drawn, "make pages draws it anew"
    folders = {p.name for p in (ROOT / "src" / "patagium").iterdir() if p.is_dir()}
    assert {*program.LAYERS} == {name for name in folders if not name.startswith("_")}


def test_functions_the_physics_names_are_there() -> None:
    named = re.findall(r"`(patagium(?:\.\w+)+)`", (DOCS / "physics.md").read_text("utf-8"))
    assert len(named) > 20
    assert [name for name in named if not _is_there(name)] == []


def _is_there(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    module, _, attribute = name.rpartition(".")
    try:
        return hasattr(importlib.import_module(module), attribute) or find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def test_every_equation_of_the_physics_has_a_number_and_a_function() -> None:
    """The function is named between the equations around it, in the same section."""
    text = (DOCS / "physics.md").read_text("utf-8")
    labels = re.findall(r"^\$\$.*\$\$ \((\w+)\)$", text, re.MULTILINE)
    assert len(labels) == text.count("$$") // 2 == len({*labels}) > 20
    for section in re.split(r"^## ", text, flags=re.MULTILINE):
        parts = re.split(r"^\$\$.*\$\$ \((\w+)\)$", section, flags=re.MULTILINE)
        for k in range(1, len(parts), 2):
            assert "`patagium." in parts[k - 1] + parts[k + 1], parts[k]


@pytest.mark.parametrize("page", _texts())
def test_links_and_pictures_of_a_page_lead_somewhere(page: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", (DOCS / page).read_text("utf-8"))
    inner = [t for t in targets if not re.match(r"[a-z]+:", t)]
    assert [t for t in inner if not (DOCS / page).parent.joinpath(t).is_file()] == []


class _Page(HTMLParser):
    """Where one can go to in a built page, and where it leads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.leads: set[str] = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.places.add(value)
            elif name in ("href", "src") and value:
                self.leads.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation, built with warnings as errors."""
    if find_spec("sphinx") is None:
        pytest.skip("sphinx is not installed: pip install 'patagium[docs]'")
    out = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(DOCS), str(out)]
    built = subprocess.run(words, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return out


def test_the_site_has_every_page_and_its_equations(site: Path) -> None:
    assert {str(Path(page).with_suffix(".html")) for page in _texts()} <= {
        str(p.relative_to(site)) for p in site.rglob("*.html")
    }
    physics = (site / "physics.html").read_text("utf-8")
    assert "<math" in physics and physics.count('class="eqno"') == physics.count('display="block"')


def test_equations_on_a_phone_end_before_their_numbers(site: Path, tmp_path: Path) -> None:
    if found() is None:
        pytest.skip("no Chromium on this machine")
    with Chromium(tmp_path, 390, 844) as browser:
        browser.go((site / "physics.html").as_uri())
        room = browser.ask("""[...document.querySelectorAll("div.math")].map((one) => {
          const [drawn, number] = [...one.children].map((k) => k.getBoundingClientRect());
          return number ? number.left - drawn.right : 0;
        })""")
    assert len(room) > 10 and min(room) > -1.0  # pixel


def test_no_link_inside_the_site_is_dead(site: Path) -> None:
    pages = {path: _Page(path) for path in site.rglob("*.html")}
    readme = re.findall(r"\]\(docs/([^)]+)\.md(#[^)]+)?\)", (ROOT / "README.md").read_text("utf-8"))
    wanted = [(site / "index.html", f"{page}.html{place}") for page, place in readme]
    wanted += [(path, lead) for path, page in pages.items() for lead in page.leads]
    dead = set()
    for path, lead in wanted:
        if re.match(r"[a-z]+:", lead) or lead.startswith("//"):
            continue
        name, _, place = lead.partition("#")
        target = (path.parent / name.partition("?")[0]).resolve() if name else path
        if not target.is_file() or (
            place and target in pages and place not in pages[target].places
        ):
            dead.add((str(path.relative_to(site)), lead))
    assert dead == set()
