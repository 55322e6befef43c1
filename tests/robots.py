"""Robots of tests."""

from __future__ import annotations

from math import inf

from patagium.robot import Body, Robot, Strip, load_robot_text

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NAMES, _UNITS = ("x", "y", "z", "roll", "pitch", "yaw"), ("m",) * 3 + ("rad",) * 3
_HALF_WING = """\
name: half_wing
gravity: 9.81 m/s^2
bodies:
  wing:
    joints: [{name: plunge, axis: x}, {name: feather, axis: -y}]
    mass: 3 g
    center_of_mass: [-1 cm, 9 cm, 0]
    shape: {type: plate, axis: y, chord: 9 cm, span: 20 cm, thickness: 1 mm}
wings:
  - name: wing
    segments:
      - body: wing
        strips: STRIPS
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -8 cm}
          - {span: 20 cm, leading: 1.5 cm, trailing: -6.5 cm}
"""


def half_wing(strips: int) -> Robot:
    """A wing that plunges and feathers on a stand."""
    return load_robot_text(_HALF_WING.replace("STRIPS", str(strips)))


def free_plate() -> Robot:
    """A free plate with one strip: at q = 0 its velocity is that of the section."""
    still, spread = (0.0, 0.0, 0.0), (1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0)
    body = Body("plate", -1, still, _AXES, (), tuple(range(6)), 0.01, still, spread)
    quarter = (0.025, 0.0, 0.0)
    strip = Strip("wing[0]", "wing", 0, False, quarter, _AXES[0], _AXES[2], 0.1, 0.024)
    limits = (-inf,) * 6, (inf,) * 6
    return Robot("plate", (body,), (strip,), _NAMES, _UNITS, (), (0.0,) * 6, *limits, 9.81)


FLAPPER = """
name: flapper
gravity: 9.81 m/s^2
bodies:
  body: {floating: true, mass: 100 g, shape: {type: box, size: [20 cm, 4 cm, 4 cm]}}
  left_wing:
    parent: body
    at: [0, 3 cm, 0]
    joints:
      - {name: left_plunge, axis: x, limits: [-60 deg, 60 deg]}
      - {name: left_feather, axis: y, limits: [-60 deg, 60 deg]}
    mass: 4 g
    center_of_mass: [0, 10 cm, 0]
    shape: {type: plate, chord: 8 cm, span: 20 cm, thickness: 1 mm}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 1
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -6 cm}
          - {span: 20 cm, leading: 2 cm, trailing: -6 cm}
mirror:
  - {from: left, to: right}
"""
"""Two stiff wings on a floating body, one strip each."""
SPRUNG = """
name: sprung
gravity: 9.81 m/s^2
bodies:
  body:
    floating: true
    mass: 25 g
    center_of_mass: [5 mm, 0, 0]
    shape: {type: cylinder, axis: x, radius: 2 cm, length: 30 cm}
  left_wing:
    parent: body
    at: [2 cm, 2 cm, 2 cm]
    joints:
      - {name: left_plunge, axis: x, limits: [-60 deg, 70 deg]}
      - {name: left_feather, axis: y, passive: true, stiffness: 0.03 N m/rad,
         damping: 1e-4 N m s/rad, limits: [-45 deg, 45 deg]}
    mass: 5 g
    center_of_mass: [-2 cm, 17.5 cm, 0]
    shape: {type: plate, chord: 12 cm, span: 35 cm, thickness: 1 mm}
wings:
  - name: left_wing
    segments:
      - body: left_wing
        strips: 2
        stations:
          - {span: 0 cm, leading: 2 cm, trailing: -12 cm, incidence: 6 deg}
          - {span: 20 cm, leading: 2 cm, trailing: -11 cm, incidence: 5 deg}
          - {span: 35 cm, leading: 0 cm, trailing: -5 cm, incidence: 3 deg}
  - name: tail
    segments:
      - body: body
        at: [-18 cm, 0, 1 cm]
        strips: 2
        stations:
          - {span: -12 cm, leading: -2 cm, trailing: -10 cm, incidence: -6 deg}
          - {span: 0 cm, leading: 0 cm, trailing: -10 cm, incidence: -6 deg}
          - {span: 12 cm, leading: -2 cm, trailing: -10 cm, incidence: -6 deg}
mirror:
  - {from: left, to: right}
cruise: {frequency: 4.7 Hz, amplitude: {plunge: 45 deg}, speed: 2.6 m/s, pitch: -10 deg}
"""
"""A bird whose wings turn on springs, two strips each."""
