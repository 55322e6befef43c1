"""Wind that grows with height: strips meet the wind at their own height."""

from __future__ import annotations

import numpy as np
import pytest

import patagium as pt
from patagium.aerodynamics import WindShear
from patagium.aerodynamics.description import aero_from_description
from patagium.aerodynamics.model import aero_functions
from patagium.errors import ParameterError
from patagium.robot import load_robot_text


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


def test_refused() -> None:
    with pytest.raises(ParameterError, match="exponent"):
        WindShear(air(), exponent=-0.1)
    with pytest.raises(ParameterError, match="roughness"):
        WindShear(air(), roughness=0.0)
    with pytest.raises(ParameterError, match="another kind than wind_shear"):
        WindShear(WindShear(air()))
