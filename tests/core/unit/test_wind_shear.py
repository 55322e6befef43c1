"""Wind that grows with height: strips meet the wind at their own height."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.robots import FLAPPER

import patagium as pt
from patagium.aerodynamics import WindShear
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.model import aero_functions
from patagium.errors import ParameterError
from patagium.learning.samples import samples
from patagium.robot import load_robot_text
from patagium.simulation.cycles import air_velocity


def air(ground: float | None = None) -> pt.QuasiSteady:
    return pt.QuasiSteady(pt.load_robot("hawk"), pt.Air(wind=(-6.0, 0.0, 0.0), ground=ground))


def lift(model: pt.air.Aerodynamics, height: float) -> float:
    """Lift of a robot that is held level at a height, nose up [N]."""
    robot, (force, *_) = model.robot, aero_functions(model)
    q = robot.coordinates(z=height, pitch=-0.1)
    wind, numbers = np.array([-6.0, 0.0, 0.0]), (robot.parameters, model.parameters)
    found = force(q, np.zeros(robot.dof), np.zeros(model.state_size), wind, *numbers)
    return float(np.array(found).ravel()[2])


@pytest.mark.parametrize("height", [5.0, 20.0])
def test_lift_goes_with_the_square_of_the_laws(height: float) -> None:
    uniform = lift(air(), 0.0)
    power = lift(WindShear(air(), reference_height=10.0, exponent=0.2), height)
    logarithm = lift(WindShear(air(), reference_height=10.0, roughness=0.03), height)
    # strips are within .3 m of the body's height
    assert power / uniform == pytest.approx((height / 10.0) ** 0.4, rel=0.01)
    wanted = (np.log(height / 0.03) / np.log(10.0 / 0.03)) ** 2
    assert logarithm / uniform == pytest.approx(wanted, rel=0.01)


PLATE = """
name: plate
gravity: 9.81 m/s^2
bodies:
  plate:
    joints: [{name: height, type: prismatic, axis: z}]
    mass: 10 g
    shape: {type: plate, chord: 10 cm, span: 20 cm, thickness: 1 mm}
wings:
  - name: plate
    segments:
      - {body: plate, strips: 1, stations: [{span: 0, leading: 2 cm, trailing: -6 cm,
         incidence: 6 deg}, {span: 20 cm, leading: 2 cm, trailing: -6 cm, incidence: 6 deg}]}
"""


@pytest.mark.usefixtures("interpreted")
def test_the_logarithmic_law_holds_down_to_the_ground() -> None:
    """It was rounded off over a hundredth of the reference height, far above the roughness."""
    heights, roughness = np.array([0.0, 0.05, 0.1, 0.2, 1.0, 10.0]), 0.03
    plate = pt.QuasiSteady(load_robot_text(PLATE), pt.Air(wind=(-6.0, 0.0, 0.0)))
    model = WindShear(plate, reference_height=10.0, roughness=roughness)
    lifts = [model.generalized_force([h], [0.0])[0] for h in heights]
    wanted = np.log(1 + heights / roughness) / np.log(1 + 10.0 / roughness)
    # on the ground half of a hundredth of the roughness is left, ln(1.005) / ln(334)
    np.testing.assert_allclose(np.sqrt(np.array(lifts) / lifts[-1]), wanted, atol=1e-3)


@pytest.mark.usefixtures("interpreted")
def test_the_power_law_near_the_ground_is_as_its_docstring_says() -> None:
    plate = pt.QuasiSteady(load_robot_text(PLATE), pt.Air(wind=(-6.0, 0.0, 0.0)))
    model, heights = WindShear(plate, reference_height=10.0), np.array([0.0, 0.05, 0.1, 10.0])
    lifts = [model.generalized_force([h], [0.0])[0] for h in heights]
    shares = np.sqrt(np.array(lifts) / lifts[-1])
    law = (heights[1:3] / 10.0) ** (1 / 7)
    np.testing.assert_allclose(shares[1:3] / law, [1.07, 1.027], atol=2e-3)
    assert shares[0] == pytest.approx(0.47, abs=2e-3)


def test_heights_are_above_the_ground() -> None:
    raised = WindShear(air(ground=-40.0))
    assert lift(raised, -20.0) == pytest.approx(lift(WindShear(air()), 20.0), rel=1e-3)


def test_wind_is_smooth_to_the_ground_and_below() -> None:
    for law in ({"exponent": 0.2}, {"roughness": 0.03}):
        model = WindShear(air(), reference_height=2.0, **law)
        found = [lift(model, z) for z in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        assert np.isfinite(found).all() and (np.diff(found) > 0).all()


def test_numbers_are_parameters_and_it_is_made_again() -> None:
    for law, name in (({"exponent": 0.2}, "exponent"), ({"roughness": 0.03}, "roughness")):
        model = pt.air.Inflow(WindShear(air(), reference_height=2.0, **law))
        again = aero_from_description(model.robot, model.describe())
        assert again.describe() == model.describe()
        names = again.parameter_names
        assert {f"wind_shear.{name}", "wind_shear.reference_height"} <= set(names)


@pytest.mark.usefixtures("interpreted")
def test_shear_is_that_of_the_wind_and_not_of_what_wings_induce(rng: np.random.Generator) -> None:
    """The order in which inflow and shear are put on a model does not matter."""
    law, numbers = {"reference_height": 2.0, "exponent": 0.3}, {"induced_factor": 1.3}
    orders = (
        WindShear(pt.air.Inflow(air(), **numbers), **law),
        pt.air.Inflow(WindShear(air(), **law), **numbers),
    )
    robot = orders[0].robot
    q, v = robot.coordinates(z=5.0), 3 * rng.normal(size=robot.dof)
    state = rng.normal(size=orders[0].state_size) / 2
    for method in ("generalized_force", "state_derivative"):
        one, other = (getattr(model, method)(q, v, state) for model in orders)
        np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-12)


@pytest.mark.usefixtures("interpreted")
def test_every_number_moves_the_lift() -> None:
    base = lift(WindShear(air(), reference_height=2.0, exponent=0.2), 5.0)
    assert lift(WindShear(air(), reference_height=2.1, exponent=0.2), 5.0) < base
    assert lift(WindShear(air(), reference_height=2.0, exponent=0.21), 5.0) > base
    rough = [lift(WindShear(air(), 2.0, roughness=z0), 5.0) for z0 in (0.03, 0.04)]
    assert rough[1] > rough[0]


HALF = FLAPPER.split("mirror:")[0]
LAW = {"reference_height": 10.0, "exponent": 0.3}


def held_air(text: str) -> pt.QuasiSteady:
    return pt.QuasiSteady(load_robot_text(text), pt.Air(wind=(-8.0, 0.0, 0.0)))


def flown(aero: Any, **start: float) -> Any:
    """Five steps at rest on a stand."""
    robot = aero.robot
    options: Any = {"duration": 0.005, "time_step": 1e-3, "mount": pt.mounts.fixed()}
    return pt.simulate(robot, aero, pt.gaits.still(robot), q=robot.coordinates(**start), **options)


@pytest.mark.parametrize(
    "put_on",
    [
        lambda air: WindShear(air, **LAW),
        lambda air: WindShear(pt.air.Inflow(air), **LAW),
        lambda air: pt.air.Inflow(WindShear(air, **LAW)),
        lambda air: pt.air.LearnedAir(WindShear(air, **LAW)),
    ],
)
@pytest.mark.usefixtures("interpreted")
def test_a_flight_records_the_wind_that_its_wings_met(put_on: Callable[..., Any]) -> None:
    """A flight recorded the wind at the reference height; airspeed and thrust were wrong."""
    flight = flown(put_on(held_air(FLAPPER)), z=1.0, roll=0.4)
    heights = flight["strip_point"].values[..., 2]
    assert np.ptp(heights[0]) > 0.05
    met = -8.0 * (heights / 10.0) ** 0.3
    # the law is rounded off at a hundredth of 10 m, by .1 % at 1 m
    np.testing.assert_allclose(flight["strip_wind"].values[..., 0], met, rtol=2e-3)
    np.testing.assert_allclose(flight["wind"].values[:, 0], met.mean(axis=1), rtol=2e-3)
    velocity = air_velocity(flight, put_on(held_air(FLAPPER)).robot)
    assert velocity[0, 0] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("knows_shear", [False, True])
@pytest.mark.usefixtures("interpreted")
def test_a_flight_in_shear_is_learned_by_the_wind_it_met(knows_shear: bool) -> None:
    """A model learned with the wind at the reference height; a grey box must not shear it twice."""
    plain = held_air(HALF)
    shear = WindShear(plain, **LAW)
    flight = flown(shear, z=1.0, pitch=-0.1)
    grey = pt.GreyBox(shear if knows_shear else plain, {"polar.lift_amplitude": 0.1})
    _, x, y, _ = samples(flight, grey)
    assert np.abs(y).max() > 0.05
    np.testing.assert_allclose(grey.evaluate(x, np.zeros(1)), y, rtol=1e-9, atol=1e-12)


@pytest.mark.usefixtures("interpreted")
def test_power_of_learned_air_is_relative_to_the_wind_that_strips_meet() -> None:
    """Power of learned forces was relative to the wind at the reference height."""
    air = held_air(FLAPPER)
    weights = np.array([0.5, 0.8, 0.1, 0.2, 0.0])
    orders = (
        WindShear(pt.air.LearnedAir(air, weights), **LAW),
        pt.air.LearnedAir(WindShear(air, **LAW), weights),
    )
    q, v = air.robot.coordinates(z=1.0, pitch=-0.2), air.robot.velocities(z=1.0, left_plunge=3.0)
    one, other = (model.strips(q, v)["power"] for model in orders)
    assert other == pytest.approx(one, rel=1e-9) and abs(one) > 0.01


@pytest.mark.usefixtures("interpreted")
def test_shear_neither_comes_nor_goes_in_a_flight() -> None:
    air = held_air(HALF)
    options: Any = {"duration": 0.005, "time_step": 1e-3, "mount": pt.mounts.fixed()}
    running = pt.Simulator(air.robot, WindShear(air), pt.gaits.still(air.robot), **options)
    with pytest.raises(ParameterError, match="shear or none, as before"):
        running.change(air.robot, air)


def test_refused() -> None:
    with pytest.raises(ParameterError, match="exponent"):
        WindShear(air(), exponent=-0.1)
    with pytest.raises(ParameterError, match="roughness"):
        WindShear(air(), roughness=0.0)
    with pytest.raises(ParameterError, match="without wind_shear in it"):
        WindShear(WindShear(air()))
    with pytest.raises(ParameterError, match="without wind_shear in it"):
        WindShear(pt.air.Inflow(WindShear(air())))
