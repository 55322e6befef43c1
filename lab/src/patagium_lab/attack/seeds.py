"""Small valid files that the program writes itself: robot, flight, settings, what was learned."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import patagium as pt
from patagium.learning import ChangeDetection, Misfit, Screening, save_model
from patagium.learning.learners.filter_learner import FilterLearner
from patagium.robot import Robot
from patagium.robot.files import load_robot_text
from patagium.sensing.force.air_force import packet_columns
from patagium.sensing.sensors.sense import save_sensor_log

ROBOT = """\
name: flapper
gravity: 9.81 m/s^2
bodies:
  body:
    floating: true
    mass: 30 g
    shape: {type: box, size: [12 cm, 2 cm, 2 cm]}
  left_wing:
    parent: body
    at: [0, 1 cm, 1 cm]
    joints:
      - {name: left_plunge, axis: x, limits: [-45 deg, 60 deg]}
    mass: 2 g
    center_of_mass: [-1 cm, 8 cm, 0]
    shape: {type: plate, chord: 6 cm, span: 16 cm, thickness: 1 mm}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 2
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -5 cm, incidence: 6 deg}
          - {span: 16 cm, leading: 1 cm, trailing: -3 cm, incidence: 5 deg}
mirror:
  - {from: left, to: right}
"""
"""Robot of two wings, one joint each."""
ELASTIC = (
    ROBOT.replace(
        "limits: [-45 deg, 60 deg]}",
        "limits: [-45 deg, 60 deg], speed_limit: 40 rad/s, effort_limit: 2 N m}\n"
        "      - {name: left_feather, axis: y, stiffness: 0.02 N m/rad, rest: 3 deg, passive: true,"
        " damping: 1e-4 N m s/rad}",
    )
    .replace(
        "thickness: 1 mm}",
        "thickness: 1 mm}\n"
        "    flexible: {elements: 2, bending: 0.03 N m^2, torsion: 0.005 N m^2, damping: 0.3 ms}",
    )
    .replace("strips: 2", "strips: 4")
    + """\
actuators:
  frequency: {range: [2 Hz, 8 Hz], rate_limit: 10 Hz/s, response_time: 0.3 s}
  plunge_amplitude: {range: [10 deg, 50 deg], rate_limit: 60 deg/s, response_time: 0.3 s}
cruise: {frequency: 5 Hz, amplitude: {plunge: 0.6 rad}, speed: 3 m/s, pitch: -0.1 rad}
"""
)
"""Robot with springs, a flexible wing, actuators and a cruise."""
PLAN = """\
robot: ornithopter
trim: {speed: 5 m/s, climb: 0 m/s, turn_rate: 0 rad/s, free: [frequency], air: quasi-steady}
truth: {masses: 0.02, air: lifting-line, density: 1.2 kg/m^3, wind: [0, 0, 0.1 m/s],
  added_mass: 0.5, polar: {lift_slope: 0.9}}
controller: {type: predictive, commands: [frequency, elevation_offset], tolerable: {yaw: 0.4}}
sensors: {std: {z: 2e-3, pitch: 5e-3}, delay: 1 ms, missing: 0.02}
events:
  - {type: gust, time: 1 s, velocity: [0, 0, 1 m/s], length_time: 300 ms}
  - {type: gust, time: 1 s, velocity: [0, 1 m/s, 0], length_time: 50 ms, stays: true}
  - {type: payload, time: 1 s, body: body, mass: 5 g, position: [0, 0, 1 cm]}
  - {type: wing_loss, time: 2 s, wing: left_wing, share: 0.05}
  - {type: polar, time: 2 s, factors: {lift_slope: 0.8}}
  - {type: stuck, time: 2 s, command: elevation_offset, value: 0.1}
duration: 4 s
time_step: 1e-4 s
seed: 1
"""
"""Plan of a closed loop, with an event of each kind."""
TRACKED = """\
robot: ornithopter
sensors: {parts: [{type: icm_42688_p, body: body, rate: 1 kHz, delay: 1 ms}, {type: as5600},
  {type: prime_x_13}]}
events: []
duration: 0.05 s
"""
"""Plan of a closed loop that flies by sensors."""
POLAR = """\
  alpha    CL        CD       CDp       CM     Top_Xtr  Bot_Xtr
 ------ -------- --------- --------- -------- -------- --------
  4.000   0.4300   0.00870   0.00260   0.0010   0.3000   0.9900
 -4.000  -0.4300   0.00870   0.00260  -0.0010   0.9900   0.3000
  0.000   0.0000   0.00650   0.00130   0.0000   0.6000   0.6000
  9.000   0.9100   0.01620   0.00830   0.0050   0.1000   1.0000
"""
"""Polar of a section, as XFOIL saves it."""
URDF = """\
<?xml version="1.0"?>
<robot name="pair">
  <link name="base"><inertial><origin xyz="0 0 0.1"/><mass value="1.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.2"/><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.2" rpy="0 0.1 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="3"/></joint>
</robot>
"""
"""Robot of two links."""
SETTINGS = """\
format: patagium settings 1
every: 10
network: {kind: dense, hidden: [8], activation: tanh}
learner: {kind: cubature, seed: 0, prior_std: 0.5, measurement_std: [0.1, 0.2], spread: 1.7}
"""
"""Settings of a learner."""
GAIT = (
    "time [s],left_plunge [rad],right_plunge [rad]\n0.0,0.0,0.0\n0.03,0.5,0.5\n0.05,0.2,0.2\n"
    "0.08,-0.3,-0.3\n0.1,0.0,0.0\n"
)
"""Table of a gait."""


@cache
def robot() -> Robot:
    """The robot of `ROBOT`."""
    return load_robot_text(ROBOT, "flapper")


@cache
def flight() -> xr.Dataset:
    """Flight of the robot of 40 samples."""
    machine = robot()
    gait = pt.gaits.sinusoidal(machine, frequency=5.0, plunge=0.6)
    air, start = pt.QuasiSteady(machine, pt.Air()), machine.coordinates(x=3.0)
    return pt.simulate(machine, air, gait, duration=0.04, time_step=1e-3, v=start)


def column_names() -> list[str]:
    """Names of the numbers of a packet of the robot."""
    return [column.name for column in packet_columns(robot())]


LEARNERS: dict[str, Callable[[], FilterLearner]] = {
    "learner.state": lambda: pt.CubatureLearner(
        pt.DenseNetwork(3, (4,), 2), prior_std=0.5, measurement_std=0.1, covariance="node"
    ),
    "state of a full filter": lambda: pt.ExtendedLearner(
        pt.DenseNetwork(3, (4,), 2),
        screening=Screening(),
        change_detection=ChangeDetection(1e-2, 5, 12),
    ),
    "state of layers, float32": lambda: pt.CubatureLearner(
        pt.DenseNetwork(3, (4,), 2), misfit=Misfit(), covariance="layer", dtype="float32"
    ),
}
"""Learners of three inputs and two outputs, before any sample, by the name of their file."""


def taught(learner: FilterLearner, samples: int = 20) -> FilterLearner:
    """The learner after some samples.

    Args:
        learner: Learner of three inputs and two outputs; it is changed.
        samples: Number of samples that it learns.
    """
    draw = np.random.default_rng(1)
    for _ in range(samples):
        learner.update(draw.normal(size=3), draw.normal(size=2))
    return learner


def learner() -> Any:
    """Learner of "learner.state" after some samples."""
    return taught(LEARNERS["learner.state"]())


def written(folder: Path) -> dict[str, Path]:
    """Valid file of each format that the program itself writes or is given, by name.

    Args:
        folder: Folder to write to.
    """
    for name, content in contents().items():
        (folder / name).write_bytes(content)
    return {name: folder / name for name in contents()}


@cache
def contents() -> dict[str, bytes]:
    """Content of the valid files by name."""
    with tempfile.TemporaryDirectory(prefix="patagium-") as folder:
        return {name: path.read_bytes() for name, path in _made(Path(folder)).items()}


def _made(folder: Path) -> dict[str, Path]:
    texts = {
        "robot.yaml": ROBOT, "elastic.yaml": ELASTIC, "robot.urdf": URDF,
        "settings.yaml": SETTINGS, "gait.csv": GAIT, "plan.yaml": PLAN, "tracked.yaml": TRACKED,
        "polar.txt": POLAR, "polar.csv": ",".join(POLAR.split(" ")),
    }  # fmt: skip
    files = {name: folder / name for name in texts}
    for name, text in texts.items():
        files[name].write_text(text)
    files["flight.nc"] = pt.save_flight(flight(), folder / "flight.nc")
    kinds = (pt.sensors.Imu, pt.sensors.MotionCapture)
    sensors: list[Any] = [kind(body="body", rate=500.0) for kind in kinds]
    sensors.append(pt.sensors.Encoder(rate=500.0))
    files["sensors.nc"] = save_sensor_log(pt.sense(flight(), sensors), folder / "sensors.nc")
    files["model.json"] = save_model(folder / "model.json", learner())
    files["learner.state"] = learner().save(folder / "learner.state")
    found = pt.identify(flight(), flight_learner(), every=5)
    files["identification.nc"] = folder / "identification.nc"
    found.save(files["identification.nc"])
    return files


def flight_learner() -> pt.CubatureLearner:
    """Learner of the flight's air, before any sample."""
    network = pt.StripNetwork(robot(), (3,))
    return pt.CubatureLearner(network, prior_std=0.3, measurement_std=1e-2, spread=1.7)
