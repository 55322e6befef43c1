"""From a flight to the orbit in the air that it has taught, in Python and on the command line.

The bird flies in air whose polar is not the book's. The orbit in the air that is learned has to be
that of the true air: to a tenth of the way from the orbit in the book's air, since the terms of the
network do not hold this polar exactly.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

import patagium as pt
from patagium.cli.estimates import left_open
from patagium.cli.main import run
from patagium.errors import ParameterError
from patagium.learning import DenseNetwork, ExtendedLearner, LinearStripNetwork
from patagium.learning.model_file import Model, model_of
from patagium.simulation.simulator import check_added_mass

SPEED = 6.0


def said(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit code, answer and complaints of the program."""
    with pytest.raises(SystemExit) as left:
        run(list(words))
    heard = capsys.readouterr()
    return int(left.value.code or 0), heard.out, heard.err


@pytest.fixture(scope="module")
def bird(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder with the bird, its flight and what was learned; orbits in book's and true air."""
    folder = tmp_path_factory.mktemp("learned_air")
    source = re.sub(r"strips: \d+", "strips: 2", pt.load_robot("ornithopter").source)
    (folder / "bird.yaml").write_text(source)
    robot = pt.load_robot(str(folder / "bird.yaml"))
    truth = pt.QuasiSteady(robot, pt.Air(density=1.18), polar=pt.air.SmoothPolar())
    book = pt.trim(robot, speed=SPEED)
    flight = pt.simulate(robot, truth, book.gait, duration=2.0, time_step=5e-4, **book.start())
    pt.save_flight(flight, folder / "flight.nc")
    result = pt.identify(flight)
    pt.learning.save_model(folder / "model.json", result.model)
    return folder, {"book": book, "true": pt.trim(robot, truth, speed=SPEED)}


def test_the_orbit_in_learned_air_is_that_in_the_true_air(
    bird: tuple[Path, dict[str, Any]],
) -> None:
    folder, orbits = bird
    model = pt.load_model(folder / "model.json")
    air, added = model.air()
    found = pt.trim(air.robot, air, speed=SPEED, added_mass=added)
    assert found.found and air.air.density == 1.18
    assert abs(added.factors["added_mass.left_wing.factor"]) < 0.05  # there is none in the truth
    for name, value in orbits["true"].parameters.items():
        apart = abs(orbits["book"].parameters[name] - value)
        assert abs(found.parameters[name] - value) <= 0.1 * apart + 1e-4, name
    assert pt.evaluate(found.flight(beats=1.0), model).scores["unseen_share"] < 0.5
    heavy = air.robot.with_parameters({"body.mass": 0.4})
    again, _ = model.air(heavy, pt.Air(density=1.0))
    assert again.robot is heavy and again.air.density == 1.0
    assert again.terms == air.terms


def test_learned_numbers_of_a_robot_go_along(bird: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = bird
    robot = pt.load_robot(str(folder / "bird.yaml"))
    box = pt.GreyBox(pt.QuasiSteady(robot), {"body.mass": 0.01, "polar.lift_amplitude": 0.1})
    learner = ExtendedLearner(box, measurement_std=1.0)
    model = model_of(learner)
    model.weights[:] = 1.0, 0.5
    wide = robot.with_parameters({"left_wing.mass": 0.05})
    air, added = model.air(wide)
    known = dict(zip(air.robot.parameter_names, air.robot.parameters, strict=True))
    was = dict(zip(robot.parameter_names, robot.parameters, strict=True))
    assert added is None and known["left_wing.mass"] == 0.05
    assert known["body.mass"] == pytest.approx(was["body.mass"] * np.exp(0.01 / was["body.mass"]))
    assert air.numbers["polar.lift_amplitude"] != box.model.numbers["polar.lift_amplitude"]


def test_draws_of_a_model_are_as_wide_as_its_weights_are_uncertain(
    bird: tuple[Path, dict[str, Any]],
) -> None:
    robot = pt.load_robot(str(bird[0] / "bird.yaml"))
    box = pt.GreyBox(pt.QuasiSteady(robot), {"body.mass": 0.01, "polar.lift_amplitude": 0.1})
    learner = ExtendedLearner(box, measurement_std=1.0)
    x = np.r_[robot.coordinates(pitch=0.2), robot.coordinates(x=SPEED)]
    learner.update(np.r_[x, np.zeros(box.inputs - len(x))], np.ones(box.outputs))
    model = model_of(learner)
    drawn = np.array([model.draw(seed).weights for seed in range(500)])
    assert (model.draw(3).weights == drawn[3]).all() and (drawn[3] != drawn[4]).all()
    root = np.linalg.inv(np.linalg.cholesky(model.covariance))
    seen = (drawn - model.weights) @ root.T  # standard normal; 500 draws: five times 1 / sqrt(n)
    assert np.abs(seen.mean(axis=0)).max() < 0.22
    assert np.abs(np.cov(seen.T) - np.eye(2)).max() < 0.32  # five times sqrt(2 / n)
    with pytest.raises(ParameterError, match="covariance: expected one"):
        replace(model, kept_covariance=None).draw(0)


def with_fin(model: Model, factor: float, variance: float) -> Model:
    """Model whose fin has another learned added mass (over the theoretical one), and variance."""
    network, kept = cast(LinearStripNetwork, model.network), model.kept_covariance
    assert kept is not None
    names = [term.name for term in network.terms]
    _, places = network.split(ca.DM(range(network.size)))
    place = int(places[names.index("acceleration of the air carried along of fin")])
    weights, matrix = model.weights.copy(), kept.dense()
    weights[place] += factor - network.air_at(weights)[1].factors["added_mass.fin.factor"]
    matrix[place, place] += variance
    return replace(model, weights=weights, kept_covariance=replace(kept, parts=(matrix,)))


def test_learned_inertia_below_zero_is_told_where_it_was_learned_and_drawn_again(
    bird: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    """As noise of angles in a symmetric flight teaches it; the fin outweighs the bird below -6.7.

    Only `trim` said so; a draw ended its recipe, and the command line counted it as searched.
    """
    model, book = pt.load_model(bird[0] / "model.json"), bird[1]["book"]
    refused = with_fin(model, -20.0, 0.0)
    flight = pt.load_flight(bird[0] / "flight.nc").isel(time=slice(0, 200)).copy(deep=True)
    flight["q"].values[:, 3:] += np.random.default_rng(0).normal(scale=2e-3, size=(200, 7))
    learner = ExtendedLearner(refused.network, measurement_std=1.0)
    learner.go_on_from(refused.weights, 1e-12 * np.eye(refused.network.size))
    for result in (pt.evaluate(flight, refused), pt.identify(flight, learner, every=100)):
        (told,) = [word for word in result.scores["verdict"] if "no flight is made" in word]
        assert "'added_mass.fin.factor': -20.0" in told and "`measured`" in told
        assert re.search("Nothing was learned of .*yaw", told)
    with pytest.raises(ParameterError, match="inertia above zero"):
        refused.air()

    def search(air: pt.air.Aerodynamics, added_mass: pt.AddedMass) -> pt.control.Orbit:
        check_added_mass(air.robot, air, added_mass)
        return cast(pt.control.Orbit, book)

    assert left_open(with_fin(model, -6.0, 9.0), book, search)  # half of the first draws refused
    assert "no such orbit" not in capsys.readouterr().err
    assert left_open(refused, book, search) == {}
    assert "is not known: added_mass" in capsys.readouterr().err


def test_networks_that_are_no_air_and_robots_that_were_not_logged(
    bird: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = bird
    dense = DenseNetwork(1, (2,), 2)
    with pytest.raises(ParameterError, match="linear_strip, the default, or numbers"):
        model_of(ExtendedLearner(dense, measurement_std=1.0)).air()
    with pytest.raises(ParameterError, match="ground: expected None"):
        pt.load_model(folder / "model.json").air(air=pt.Air(ground=0.0))
    with pytest.raises(ParameterError, match="robot: expected ornithopter .* found 'aerobat'"):
        pt.load_model(folder / "model.json").air(pt.load_robot("aerobat"))


def test_verbs_take_learned_air(
    bird: tuple[Path, dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder, orbits = bird
    monkeypatch.chdir(folder)
    learned = "bird.yaml", "--aero", "model.json"
    code, out, err = said(capsys, "trim", *learned, "--speed", "6", "--json")
    facts, true = json.loads(out), orbits["true"].parameters["frequency"]
    assert facts["frequency_Hz"] == pytest.approx(true, abs=0.01)
    assert "learned from" in err and "1.18 kg/m^3" in err
    assert "of this flow was not learned" in err
    assert "What is learned leaves this orbit uncertain. Of 8 trims with other weights" in err
    assert [*facts["left_open"]] == [*orbits["true"].parameters]
    assert abs(facts["frequency_Hz"] - true) < facts["left_open"]["frequency"] < 0.05 * true
    tunnel = re.sub(
        r'"wind": \[[^]]*\]', '"wind": [-5.0, 0.0, 0.0]', Path("model.json").read_text()
    )
    assert tunnel.count("-5.0, 0.0, 0.0") == 1
    Path("tunnel.json").write_text(tunnel)  # a log of a wind tunnel
    code, out, err = said(
        capsys, "trim", "bird.yaml", "--aero", "tunnel.json", "--speed", "6", "--json"
    )
    assert json.loads(out)["frequency_Hz"] == pytest.approx(true, abs=0.01), err
    code, out, err = said(capsys, "simulate", *learned, "--duration", "0.2", "-o", "f.nc")
    assert code == 0
    flown = pt.load_flight("f.nc")
    assert pt.simulation.added_mass_of(flown) is not None
    for wind in ((), ("--wind", "-5,0,0")):  # the log's counts only where it is stated
        also = "--aero", "tunnel.json", "--duration", "0.2", *wind, "-o", "t.nc"
        code, out, err = said(capsys, "simulate", "bird.yaml", *also)
        again = pt.load_flight("t.nc")
        assert np.allclose(again.q[-1], flown.q[-1], atol=1e-9) is not bool(wind)
        assert pt.simulation.air_of(again).wind == (-5.0 * bool(wind), 0.0, 0.0)
        assert code == 0 and ("the log's wind was (-5.0" in err) is not bool(wind)
    Path("plan.yaml").write_text(
        "robot: bird.yaml\ntrim: {speed: 6 m/s, air: model.json}\n"
        "truth: {masses: 0, air: tunnel.json}\nevents: []\nduration: 0.5 s\ntime_step: 0.5 ms\n"
    )
    code, out, err = said(capsys, "fly", "plan.yaml", "-o", "flown.nc")
    assert code == 0 and "tunnel.json air" in err
    flown = pt.load_flight("flown.nc")
    height = np.interp(flown["control_time"], flown["time"], flown["q"].sel(dof="z"))
    apart = height - flown["reference"].sel(state="z")
    assert float(np.abs(apart).max()) < 1e-3  # the controller knows this air
    for words, told in (
        (("--aero", "model.json", "--polar", "reynolds"), "nothing beside a learned model"),
        (("--aero", "model.jsn"), "or a model .* that patagium identify wrote"),
        (("--aero", "flight.json"), "flight.json"),
    ):
        code, out, err = said(capsys, "trim", "bird.yaml", *words)
        assert code == 2 and re.search(told, err)


def test_side_forces_that_grow_from_rounding_do_not_spoil_the_others(
    bird: tuple[Path, dict[str, Any]],
) -> None:
    """As in flights of a simulator, which begin symmetric; tones stand for what no weight explains.

    Means over all of the flight lagged behind them: .0023, 9e-4, 9e-4 and 2e-4 of the variances.
    """
    flight, count = bird[1]["book"].flight(beats=24.0), 800
    time = np.linspace(0.0, 0.999 * float(flight.time[-1]), count)
    q, v, a = (
        np.array([np.interp(time, flight.time, one) for one in flight[name].values.T]).T
        for name in "qva"
    )
    robot = pt.load_robot(str(bird[0] / "bird.yaml"))
    grown = 10.0 ** np.minimum(np.linspace(-12.0, 4.0, count), -2.0)
    for name, share in (("roll", 1.0), ("yaw", 0.7), ("rudder", 1.0)):
        turn, place = 2 * np.pi * 1.3 * time, robot.index(name)
        q[:, place] += share * grown * np.sin(turn)
        v[:, place] += share * grown * 8.0 * np.cos(turn)
    y = pt.QuasiSteady(robot, polar=pt.air.ReynoldsPolar()).batch.generalized_force(q, v)
    for name, share in (("y", 5.0), ("roll", 1.0), ("yaw", 1.0), ("rudder", 0.05)):
        phase = 2 * np.pi * 3.7 * time + len(name)
        y[:, robot.index(name)] += share * grown * np.sin(phase)
    network = pt.learning.LinearStripNetwork(robot)
    learner, error = ExtendedLearner(network), np.empty_like(y)
    for k, x in enumerate(np.hstack([q, v, a])):
        error[k] = y[k] - network(x, learner.weights)
        learner.update(x, y[k], time=float(time[k]))
    rows, half = [robot.index(name) for name in ("x", "z", "pitch", "left_plunge")], count // 2
    share = (error[half:, rows] ** 2).mean(axis=0) / y[half:, rows].var(axis=0)
    assert share.max() < 4e-4
