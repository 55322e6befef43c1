"""Wrong uses of the program and of the package: each is answered by one sentence.

The sentences stand in `wrong_uses.txt`: what was expected, what was found, what to type.
`make golden` writes them anew; read the difference.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.cli.main import run
from patagium.robot import preset_text

SAID = Path(__file__).with_name("wrong_uses.txt")
ORNITHOPTER = preset_text("ornithopter")
FILES = {
    "typo.yaml": ORNITHOPTER.replace("mass: 45 g", "mas: 45 g"),
    "unit.yaml": ORNITHOPTER.replace("mass: 45 g", "mass: 45 cm"),
    "missing.yaml": ORNITHOPTER.replace("    mass: 45 g\n", ""),
    "shape.yaml": ORNITHOPTER.replace("type: plate, chord: 25", "type: plat, chord: 25"),
    "parent.yaml": ORNITHOPTER.replace("parent: body\n    at: [-2", "parent: boddy\n    at: [-2"),
    "strips.yaml": ORNITHOPTER.replace("strips: 8", "strips: eight"),
    "bare.yaml": ORNITHOPTER.replace("incidence: 4 deg", "incidence: 4"),
    "limits.yaml": ORNITHOPTER.replace("[-45 deg, 60 deg]", "[60 deg, -45 deg]"),
    "cruise.yaml": ORNITHOPTER.replace("{plunge: 0.784 rad}", "{plung: 0.784 rad}"),
    "joins.yaml": ORNITHOPTER.replace(
        "- name: tailplane\n", "- name: tailplane\n    joins: [fn]\n"
    ),
    "turns.yaml": ORNITHOPTER.replace("left_plunge, axis: x", "left_plunge", 1),
    "colon.yaml": ORNITHOPTER.replace("mass: 45 g", "mass 45 g"),
    "space.yaml": ORNITHOPTER.replace("floating: true", "floating:true"),
    "brace.yaml": ORNITHOPTER.replace("8 cm]}", "8 cm]"),
    "loop.yaml": ORNITHOPTER.replace("parent: body\n", "parent: left_wing\n", 1),
    "nohead.csv": "0.0,1,2\n0.1,2,3\n0.2,3,4\n",
    "empty_map.yaml": "time: {restamp: '??? Hz'}\ninputs: [{column: a, unit: m}]\n",
    "brief.yaml": "every: 10\nnetwork: dense\n",
    "still.yaml": ORNITHOPTER[: ORNITHOPTER.index("# nearly level")],
    "command.yaml": ORNITHOPTER.replace("elevation_offset: {range", "elevation_ofset: {range"),
    "rate.yaml": ORNITHOPTER.replace("rate_limit: 10 Hz/s", "rate_limt: 10 Hz/s"),
    "range.yaml": ORNITHOPTER.replace("range: [2 Hz, 5.5 Hz]", "range: [5.5 Hz, 2 Hz]"),
    "dimension.yaml": ORNITHOPTER.replace("range: [2 Hz, 5.5 Hz]", "range: [2 m, 5.5 m]"),
    "key.yaml": "robot: ornithopter\ncontroler: {type: regulator}\n",
    "slow.yaml": "robot: ornithopter\nduration: 1 m\n",
    "broken.yaml": "name: [a\nb: {",
    "empty.yaml": "",
    "text.nc": "hello",
    "log.csv": "t,a,b\n0.0,1,2\n0.1,2,3\n0.2,3,4\n",
    "map.yaml": "time: {colum: t, unit: s}\ninputs: [{column: a, unit: m}]\n"
    "outputs: [{column: b, unit: N}]\n",
    "plan.yaml": "robot: ornithopter\ntruth: {mases: 0.01}\nevents:\n"
    "  - {type: gst, time: 1 s}\n  - {type: payload, time: 1 kg, body: body, mass: 5 g}\n",
    "settings.yaml": "format: patagium settings 1\nevery: 10\n"
    "network: {kind: dense, hidden: [3]}\nlearner: {kind: extended, prior_st: 0.5}\n",
}
PROGRAM = """
simulte aerobat
study reprodce
simulate
simulate aerobot
simulate flight.nc
simulate nothing.yaml
simulate typo.yaml
simulate unit.yaml
simulate missing.yaml
simulate shape.yaml
simulate parent.yaml
simulate strips.yaml
simulate limits.yaml
simulate cruise.yaml
simulate joins.yaml
simulate turns.yaml
simulate colon.yaml
simulate space.yaml
simulate brace.yaml
simulate loop.yaml
simulate aerobat --network linear_strip
simulate still.yaml
simulate broken.yaml
simulate empty.yaml
simulate aerobat --freqency 5
simulate aerobat --frequency '5 kg'
simulate aerobat --frequency fast
simulate aerobat --frequency 0
simulate aerobat --plunge 30
simulate aerobat --pitch '5 m'
simulate aerobat --duration 0
simulate aerobat --duration '2 m'
simulate aerobat --duration 1 --time-step 3e-4
simulate aerobat --time-step 1e-2 --duration 0.1
simulate aerobat --amplitude elbow
simulate aerobat --amplitude elbw='3 deg'
simulate aerobat --aero lifting_line
simulate aerobat --wind 3
simulate aerobat --gait sinus
simulate aerobat --gait gait.csv
simulate aerobat --mount arm
simulate aerobat --figure flight.bmp
simulate aerobat -o nowhere/flight.nc
simulate aerobat -o .
simulate aerobat -o flight.txt
simulate aerobat --pitch 5
simulate bare.yaml
simulate aerobat -o
robots aerobat --draw
identify flght.nc
identify text.nc
identify aerobat
identify typo.yaml
identify log.csv
identify log.csv --mapping map.yaml
identify flight.nc --settings settings.yaml
identify flight.nc --settings brief.yaml
identify flight.nc --misfit 0.1 --noise-memory 100
identify flight.nc --network flow
identify flight.nc --hidden 8,x
identify flight.nc --prior-std -1
identify flight.nc --every 0
identify flight.nc --horizon soon
identify flight.nc --horizon 5
view aerobat
view flight.nc --model flight.nc
view flight.nc --model modl.json
view flight.nc --out page.txt
view flight.nc --still picture.bmp
view flight.nc --still picture.png --film film.gif
view flight.nc flight.nc --still picture.png
view flight.nc --still picture.png --start 0.01 --end 0.02
view flight.nc --film film.gif --title Flight
stream flight.nc --robot aerobat
stream udp://127.0.0.1:9000
view model.json
fly
fly ornithoptr
fly plan.yaml
fly dragonfly
fly ornithopter --seed -1
fly key.yaml
fly slow.yaml
fly ur5e
fly aerobat --duration 0
trim aerobat --along sped=2:6
trim aerobat --along speed=2:a
trim aerobat --free frequncy
trim aerobat --free plunge
trim aerobat --free left_elbow
trim aerobat --polar flat
trim aerobat --polar flat=dickinson
trim aerobat --aero published
trim aerobat --figure branch.png
trim yeo-wing
optimize aerobat --goal powr
optimize aerobat --harmonics 0
optimize hawk
simulate aerobat --ground low
simulate aerobat --inflow 3
simulate aerobat --inflow=3
simulate aerobat hawk
cache --clear now
simulate command.yaml
simulate rate.yaml
simulate range.yaml
simulate dimension.yaml
simulate ur5e
export flight.nc -o flight.csv
inspect flight.nc
inspect nohead.csv
motion flight.nc
send flight.nc tcp://127.0.0.1:9000
stream udp://127.0.0.1 --robot aerobat
cycles flight.nc --skip 100
figures flight.nc --for poster
robots aerobt
robots --new hawk
robots aerobat --draw a.bmp
robots --draw a.png
check figure.png
check log.csv
check map.yaml
check settings.yaml
evaluate flight.nc model.json
import log.csv
import log.csv --map map.yaml -o log.csv
import log.csv --map empty_map.yaml
"""
PACKAGE = """
pt.Quasisteady
pt.gait
pt.loadrobot
pt.air.Drydengust
pt.control.Predictive_Controller
pt.errors.Parametererror
pt.learning.load_setings
pt.sensing.Motiontracker
pt.gaits.sinusoid
pt.mounts.onarm
pt.paths.figureofeight
pt.sensors.IMU
pt.load_robot("aerobt")
pt.load_flight("model.json")
pt.load_model("flight.nc")
pt.Air(density=-1)
pt.Air(density="1.2 kg/m^3")
pt.Air(wind=3)
pt.Air(ground="1 m")
pt.air.WindShear("aerobat")
pt.air.WindShear(aero, exponent=-1)
pt.air.Inflow(robot)
pt.trim(robot, gait)
pt.trim(robot, speed="3 m/s")
pt.Dynamics("aerobat")
pt.gaits.sinusoidal("aerobat", frequency=5)
pt.gaits.sinusoidal(robot, frequency=5, pluge=0.5)
pt.gaits.sinusoidal(robot, frequency="5 Hz")
pt.simulate("aerobat", aero, gait, duration=0.1)
pt.simulate(robot, gait, aero, duration=0.1)
pt.simulate(pt.load_robot("hawk"), aero, gait, duration=0.1)
pt.simulate(robot, aero, gait, duration="1 s")
pt.simulate(robot, aero, gait, duration=0.1, time_step=0.03)
pt.simulate(robot, aero, gait, duration=0.1, timestep=0.01)
pt.simulate(robot, aero, gait, duration=0.1, v=np.zeros(3))
pt.simulate(robot, aero, gait, duration=0.1, mount="fixed")
pt.simulate(robot, aero, gait, duration=0.1, controller=3)
robot.coordinates(left_plung=0.1)
robot.with_parameters({"body.mas": 0.1})
pt.identify("flight.nc")
pt.identify(flight, "cubature")
pt.identify(flight, pt.CubatureLearner)
pt.identify(flight, every=0)
pt.evaluate(flight, "model.json")
pt.replay("flight.nc", "page.html")
pt.cycle_statistics(robot)
pt.save_flight(robot, "robot.nc")
pt.CubatureLearner(network, prior_st=1.0, measurement_std=0.1)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a flight, a model and wrong files."""
    folder = tmp_path_factory.mktemp("wrong")
    flight, model = str(folder / "flight.nc"), str(folder / "model.json")
    for words in (
        ["simulate", "aerobat", "--duration", "0.3", "--time-step", "1e-3", "-o", flight],
        ["identify", flight, "--model", model],
    ):
        with pytest.raises(SystemExit):
            run(words)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


def _answer(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        run(shlex.split(words))
    said = capsys.readouterr().err
    assert left.value.code == 2, said
    said = re.sub(r"(reached|answers at) \S+", r"\1 NUMBER", said)  # of a run that broke down
    return "\n".join(re.findall(r"^patagium: (?!compiling)(.*)", said, re.MULTILINE))


def _raised(words: str, names: dict[str, Any]) -> str:
    try:
        eval(words, names)  # noqa: S307 - words of this file
    except (pt.PatagiumError, AttributeError, TypeError) as error:
        return f"{type(error).__name__}: {error}"
    raise AssertionError(f"{words} was not refused")


def _is_sentence(answer: str, place: Path) -> bool:
    """One line that says what was expected and found, or what to do."""
    inner = ("0x", "Traceback", "Value error", str(place))
    mended = "cannot be written", "has no attribute", "shorten the time step"
    told = re.search(r"expected .+(found|did you mean) ", answer) or any(
        k in answer for k in mended
    )
    return bool(told) and len(answer) < 420 and not any(k in answer for k in ("\n", *inner))


def test_every_wrong_use_is_answered_by_a_sentence(
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    accepted: bool,
) -> None:
    monkeypatch.chdir(place)
    robot = pt.load_robot("aerobat")
    names = {
        "pt": pt, "np": np, "robot": robot, "aero": pt.QuasiSteady(robot),
        "gait": pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5),
        "flight": pt.load_flight("flight.nc"), "network": pt.StripNetwork(robot),
    }  # fmt: skip
    before = (place / "flight.nc").read_bytes()
    said = {f"$ patagium {k}": _answer(k, capsys) for k in PROGRAM.strip().splitlines()}
    said |= {f">>> {k}": _raised(k, names) for k in PACKAGE.strip().splitlines()}
    assert len(said) >= 60
    bad = {words: answer for words, answer in said.items() if not _is_sentence(answer, place)}
    assert not bad
    assert (place / "flight.nc").read_bytes() == before
    text = "".join(f"{words}\n{answer}\n\n" for words, answer in said.items())
    if accepted:
        SAID.write_text(text)
    assert text == SAID.read_text()
