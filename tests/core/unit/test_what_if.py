"""What if a log were mistaken: each mistake of a laboratory is named, and a right log is not."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import patagium as pt
from patagium.learning.models.linear_strip import LinearStripNetwork
from patagium.learning.samples import samples, stds
from patagium.learning.what_if import what_if
from patagium.robot import load_robot_text
from patagium.sensing.force.air_force import training_data
from patagium.simulation import gait_period

ROBOT = pt.load_robot("aerobat")
HEAVY_WING = """
name: heavy_wing
gravity: 0
bodies:
  wing:
    joints: [{name: plunge, axis: x}, {name: feather, axis: -y}]
    mass: 5 g
    center_of_mass: [0, 8 cm, 0]
    shape: {type: plate, axis: y, chord: 7 cm, span: 18 cm, thickness: 1 mm}
wings:
  - name: wing
    segments:
      - body: wing
        strips: 5
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -6 cm}
          - {span: 18 cm, leading: 1.5 cm, trailing: -4.5 cm}
"""
Mistake = Callable[[xr.Dataset], xr.Dataset]


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    """In air that is not quite that of the network: another polar, and added mass."""
    aero = pt.QuasiSteady(ROBOT, polar=pt.air.SmoothPolar(2.2, 0.1, 2.0))
    flown = pt.simulate(
        ROBOT, aero, duration=0.6, time_step=1e-3, added_mass=pt.AddedMass(ROBOT, factor=0.7)
    )
    return flown.assign_attrs(air=json.dumps(pt.Air().describe()))


@pytest.fixture(scope="module")
def network() -> LinearStripNetwork:
    return LinearStripNetwork(ROBOT)


def asked(log: xr.Dataset | pt.sensing.ForceSamples, network: LinearStripNetwork) -> list[str]:
    """Words on a log, as `identify` asks for them."""
    period = gait_period(log) if isinstance(log, xr.Dataset) else None
    return what_if(network, samples(log, network)[:3], stds(log, network), period)


def turned(names: str, parts: str) -> Mistake:
    """Another sign of coordinates in some quantities."""
    signs = xr.DataArray([-1.0 if k in names.split() else 1.0 for k in ROBOT.dof_names], dims="dof")

    def made(flight: xr.Dataset) -> xr.Dataset:
        return flight.assign({name: flight[name] * signs for name in parts.split()})

    return made


def exchanged(parts: str) -> Mistake:
    """Columns of two joints, one in the place of the other."""
    places = [ROBOT.index("left_plunge"), ROBOT.index("left_elbow")]
    order = np.arange(ROBOT.dof)
    order[places] = places[::-1]

    def made(flight: xr.Dataset) -> xr.Dataset:
        return flight.assign(
            {k: (flight[k].dims, flight[k].values[:, order]) for k in parts.split()}
        )

    return made


def shifted(name: str, offset: float) -> Mistake:
    """A zero of a joint that is off."""
    return lambda flight: flight.assign(q=flight.q + offset * (flight.dof == name))


def late(samples: int, names: str = "q v a") -> Mistake:
    """Joints whose stamps come late, or their forces with them."""

    def made(flight: xr.Dataset) -> xr.Dataset:
        joints = flight.dof.isin([ROBOT.dof_names[k] for k in ROBOT.actuated])
        moved = {k: flight[k].roll(time=samples).where(joints, flight[k]) for k in names.split()}
        return flight.assign(moved).isel(time=slice(samples, None))

    return made


BASE = "x y z roll pitch yaw"


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (turned("left_plunge", "q v a"), "if left_plunge had the other sign"),
        (turned("left_feather", "u1"), "if the force of left_feather had the other sign"),
        (
            turned("left_feather right_feather", "q v a u1"),
            "if left_feather and right_feather and the forces of left_feather and right_feather",
        ),
        (turned("y z pitch yaw", "q v a"), "z pointed down (another sign of y, z, pitch, yaw)"),
        (shifted("right_plunge", 0.1), "right_plunge were 5.7 deg less"),
        (late(6), "joints were stamped 6 ms earlier"),
        (late(6, "q v a u1"), "if joints and their forces were stamped 6 ms earlier"),
        (exchanged("q v a u1"), "if left_plunge and left_elbow were exchanged"),
        (exchanged("q v a"), "if the angles of left_plunge and left_elbow were exchanged"),
    ],
)
def test_a_mistake_is_named(
    flight: xr.Dataset, network: LinearStripNetwork, mistake: Mistake, words: str
) -> None:
    (told,) = asked(mistake(flight), network)
    assert words in told, told


def test_wind_that_is_stated_wrongly_is_named(flight: xr.Dataset) -> None:
    (told,) = asked(flight, LinearStripNetwork(ROBOT, pt.Air(wind=(0.0, 0.6, 0.0))))
    assert "if the wind along y were 0.6 m/s less" in told, told


def test_a_wind_of_the_other_sign_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search reached 3 m/s from the stated wind; the wind of the other sign is 6 m/s away."""
    monkeypatch.setattr("patagium.learning.what_if._LEAST", 1e-5)  # weights err by 1e-4 with it
    gait, held = pt.gaits.linkage(ROBOT, frequency=5.0), pt.mounts.fixed()
    aero = pt.QuasiSteady(ROBOT, pt.Air(wind=(-3.0, 0.0, 0.0)))
    flight = pt.simulate(ROBOT, aero, gait, duration=0.6, time_step=5e-4, mount=held)
    (told,) = asked(flight, LinearStripNetwork(ROBOT, pt.Air(wind=(3.0, 0.0, 0.0))))
    assert "if the wind along x were 6 m/s less" in told, told


def test_a_right_log_is_not_asked_whatever_its_air_and_noise(
    flight: xr.Dataset, network: LinearStripNetwork, rng: np.random.Generator
) -> None:
    assert asked(flight, network) == []
    noise = {
        k: flight[k] + 0.05 * flight[k].std("time").values * rng.normal(size=flight[k].shape)
        for k in "va"
    }
    assert asked(flight.assign(noise), network) == []
    assert asked(flight, LinearStripNetwork(ROBOT, attached=True)) == []
    assert asked(flight.isel(time=slice(50)), network) == []  # too short to tell


def test_noise_of_a_joint_whose_torque_is_mostly_inertia_is_no_mistake(
    rng: np.random.Generator,
) -> None:
    """A noisy log with right signs was said to be 23 times better with another sign.

    Exchanged columns put the torque of the feathering joint, of no lever at the quarter chord, in
    the place of the noisy one.
    """
    robot = load_robot_text(HEAVY_WING)
    network = LinearStripNetwork(robot)
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.5, feather=0.3)
    flown = pt.simulate(robot, pt.QuasiSteady(robot), gait, duration=0.6, time_step=1e-3)
    noise = 0.2 * samples(flown, network)[2].std(axis=0) * rng.normal(size=flown.u1.shape)
    flight = flown.assign(u1=flown.u1 + noise)
    assert asked(flight, network) == []


def test_measured_forces_are_asked_within_their_noise(rng: np.random.Generator) -> None:
    """A robot on a load cell in the wind, whose force along x has the wrong sign or not."""
    air = pt.Air(wind=(-4.0, 0.0, 0.0))
    gait, held = pt.gaits.linkage(ROBOT, frequency=5.0), pt.mounts.fixed()
    flight = pt.simulate(
        ROBOT, pt.QuasiSteady(ROBOT, air), gait, duration=0.4, time_step=1e-3, mount=held
    )
    time, x, y = training_data(flight, ROBOT, with_added_mass=True)
    known = np.arange(ROBOT.dof) < 6
    std = np.where(known, 0.02 * y.std(axis=0), np.nan)
    covariance = np.einsum("i,ij->ij", std**2, np.eye(len(std))) * np.ones((len(y), 1, 1))
    q, v = np.split(x, 2, axis=1)
    network = LinearStripNetwork(ROBOT, air, ROBOT.dof_names[:6])
    for sign, words in ((1.0, []), (-1.0, ["if the force of x had the other sign"])):
        mount = flight.mount_force.values * np.where(np.array(ROBOT.dof_names) == "x", sign, 1.0)
        force = y + flight.mount_force.values - mount + std * rng.normal(size=y.shape)
        parts: Any = (time, q, v, force, covariance, ROBOT, "load cell", flight.a.values, air)
        told = asked(pt.sensing.ForceSamples(*parts), network)
        assert len(told) == len(words)
        assert all(one in told[0] for one in words), told


def test_one_side_that_is_measured_is_asked_too(flight: xr.Dataset) -> None:
    network = LinearStripNetwork(ROBOT, pt.Air(), ("left_plunge",))
    log = flight.isel(time=slice(None, None, 6))  # of one output all samples count
    (told,) = asked(turned("left_plunge", "u1")(log), network)
    assert "the force of left_plunge had the other sign" in told, told


def test_slopes_times_weights_are_the_outputs(
    network: LinearStripNetwork, rng: np.random.Generator
) -> None:
    x, weights = rng.normal(size=(3, network.inputs)), rng.normal(size=network.size)
    found = network.slopes(network.encode(x)) @ weights
    np.testing.assert_allclose(found, network.evaluate(x, weights), rtol=1e-12)  # rounding


def test_the_verdict_of_an_imported_flight_holds_it_and_that_of_a_simulation_not(
    flight: xr.Dataset,
) -> None:
    mistaken = turned("left_plunge", "q v a")(flight)
    words = "would explain this log"
    assert any(words in one for one in pt.identify(mistaken).scores["verdict"])
    del mistaken.attrs["air"]
    assert not any(words in one for one in pt.identify(mistaken).scores["verdict"])
