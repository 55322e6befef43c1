"""A grey box: numbers of the air as weights, what they do, and how they are said."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import patagium as pt
from patagium.errors import ParameterError, ShapeError
from patagium.learning import load_model, model_of, network_from_description, save_model
from patagium.learning.identify import compare
from patagium.learning.model_file import Model
from patagium.learning.models.memory import memory_of, network_inputs
from patagium.learning.models.physical import unit_of, written_unit
from patagium.learning.parameter_paths import parameter_scores
from patagium.learning.samples import samples
from patagium.learning.stream import stream
from patagium.robot import load_robot_text

LAGS = {"lags.rate[0]": 0.02, "lags.lift[1]": 0.1, "section.lift_slope": 0.5}
AIR = pt.Air(wind=(-5.0, 0.0, 0.0))


def motion(robot, samples=120, duration=0.3):
    """Time and [q, v, a] of a wing that flaps in a wind, (N, 9)."""
    time = np.linspace(0.0, duration, samples)
    parts = np.zeros((3, samples, 3))
    for k, (size, beat, phase) in enumerate([(0.02, 15, 0.4), (0.5, 25, 0), (0.2, 25, 1.4)]):
        turn = beat * time + phase
        parts[0, :, k] = size * np.sin(turn)
        parts[1, :, k] = size * beat * np.cos(turn)
        parts[2, :, k] = -size * beat**2 * np.sin(turn)
    return time, np.hstack(list(parts))


@pytest.fixture(scope="module")
def robot(one_wing):
    return one_wing(
        "name: slide, type: prismatic, axis: z", "name: plunge, axis: x", "name: feather, axis: -y"
    )


@pytest.fixture(scope="module")
def grey(robot):
    return pt.GreyBox(pt.LiftingLine(robot, AIR), LAGS)


@pytest.fixture(scope="module")
def log(robot):
    time, x = motion(robot)
    return time, x[:, :6]


def test_values_are_those_of_the_model_with_its_numbers(grey, log):
    time, x = log
    weights = np.array([0.5, -0.3, 1.2])
    rows = network_inputs(grey, weights, time, x)
    model, added = grey.air_at(weights)
    assert added is None and model.lags.rate[0] == pytest.approx(
        0.0455 * np.exp(0.5 * 0.02 / 0.0455)
    )
    assert model.lags.lift[1] == pytest.approx(0.335 - 0.03, rel=1e-15)
    expected = model.batch.generalized_force(x[:, :3], x[:, 3:], rows[:, 6:10])
    assert np.allclose(grey.evaluate(rows, weights), expected, rtol=1e-12, atol=1e-15)


def test_memory_starts_where_the_flow_was_always_there_or_still(grey, log, robot):
    time, x = log
    weights = np.zeros(3)
    begun = network_inputs(grey, weights, time[:1], x[:1])[0, 6:10]
    model = pt.LiftingLine(robot, AIR)
    assert np.abs(model.state_derivative(x[0, :3], x[0, 3:], begun)).max() < 1e-8  # a fixed point
    still = pt.GreyBox(model, LAGS, start="still")
    assert not network_inputs(still, weights, time[:1], x[:1])[0, 6:-3].any()


def test_a_log_in_blocks_is_the_log_at_once(grey, log):
    time, x = log
    weights = np.array([0.2, 0.1, -0.4])
    whole = network_inputs(grey, weights, time, x, gaps=[70])
    memory = memory_of(grey)
    first = memory.recall(weights, time[:50], x[:50])
    second = memory.recall(weights, time[50:], x[50:], [20])
    assert np.array_equal(np.vstack([first, second]), whole)


def test_points_and_slopes_are_one_function_of_the_weights(grey, log):
    """Also at weights that memory was not recalled with."""
    time, x = log
    row = network_inputs(grey, np.zeros(3), time, x)[60]
    encoding, weights = grey.encode_one(row), np.array([0.3, -0.2, 0.5])
    points = weights + np.random.default_rng(0).normal(size=(7, 3))
    by_one = [grey(row, point) for point in points]
    assert np.allclose(grey.values(encoding, points), by_one, rtol=1e-12)  # rounding
    value, slope = grey.linearized(encoding, weights)
    assert np.allclose(value, grey(row, weights), rtol=1e-12)
    ahead = [(grey(row, weights + h) - grey(row, weights - h)) / 2e-5 for h in 1e-5 * np.eye(3)]
    assert np.allclose(slope, np.transpose(ahead), rtol=1e-6, atol=1e-9)  # step squared


@pytest.mark.parametrize("learner", [pt.ExtendedLearner, pt.CubatureLearner])
def test_numbers_are_found_and_kept_in_files(learner, grey, robot, tmp_path):
    time, x = motion(robot, 300, 0.6)
    truth = np.array([0.8, -0.5, 0.6])
    y = grey.evaluate(network_inputs(grey, truth, time, x[:, :6]), truth)
    noise = 0.01 * y.std(axis=0)
    y = y + noise * np.random.default_rng(1).normal(size=y.shape)
    student = learner(grey, measurement_std=noise)
    assert np.allclose(student.variances, 1.0)
    result = stream(student, time, x[:, :6], y, every=3)
    assert result.scores["nmse_second_half_worst"] < 1e-3
    found, expected = grey.estimates(student.weights, student.variances), grey.estimates(truth)
    for one, right in zip(found, expected, strict=True):
        assert abs(one.value - right.value) < 3 * one.std < one.prior_std
    path = result.prediction["parameter_value"]
    assert path.shape == (100, 3) and path[-1, 0] == found[0].value
    assert result.scores["parameter_std"]["lags.rate[0]"] == found[0].std
    model = load_model(save_model(tmp_path / "m.json", model_of(student)))
    again = compare(model, time, x[:, :6], y)
    assert again.scores["parameter_value"] == result.scores["parameter_value"]
    twin = pt.load_learner(student.save(tmp_path / "state"), like=student)
    row = network_inputs(grey, student.weights, time, x[:, :6])[-1]
    assert np.array_equal(twin.update(row, y[-1]), student.update(row, y[-1]))
    assert np.array_equal(twin.weights, student.weights)


@pytest.mark.usefixtures("interpreted")
def test_numbers_of_the_robot_and_added_mass_are_found_in_a_flight(robot):
    """What y is, and that x then has accelerations: a flight with another mass and chord."""
    true = robot.with_parameters({"wing.mass": 0.005, "wing[1].chord": 0.1})
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.6, feather=0.2)
    aero = pt.QuasiSteady(true, AIR)
    carried = pt.AddedMass(true, AIR)
    flight = pt.simulate(true, aero, gait, duration=0.5, time_step=1e-3, added_mass=carried)
    estimate = {"wing.mass": 0.001, "wing[1].chord": 0.01, "added_mass.factor": 0.3}
    grey = pt.GreyBox(pt.QuasiSteady(robot, AIR), estimate, pt.AddedMass(robot, AIR, factor=0.8))
    assert grey.flight_terms.acceleration and grey.flight_terms.added_mass
    assert samples(flight, grey)[1].shape == (501, 9)
    learner = pt.ExtendedLearner(grey, measurement_std=1e-4)
    result = pt.identify(flight, learner, every=5)
    right = {"wing.mass": 0.005, "wing[1].chord": 0.1, "added_mass.factor": 1.0}
    for name, value in result.scores["parameter_value"].items():
        assert value == pytest.approx(right[name], rel=2e-3)  # linearized, little noise assumed
    model, added = grey.air_at(learner.weights)
    assert added.factor == result.scores["parameter_value"]["added_mass.factor"]
    assert model.robot.strips[1].chord == result.scores["parameter_value"]["wing[1].chord"]


GROUND = pt.Air(wind=(-5.0, 0.0, 0.0), ground=-1.0)


@pytest.mark.parametrize(
    ("wrapped", "name", "unit"),
    [
        (lambda m: m, "ground", "m"),
        (lambda m: replace(m, rotational=True), "rotational_coefficient", "1"),
        (lambda m: pt.air.Inflow(m), "inflow.induced_factor", "1"),
        (lambda m: pt.air.Inflow(m), "density", "kg/m^3"),
        (lambda m: pt.air.WindShear(pt.air.Inflow(m)), "wind_shear.exponent", "1"),
        (lambda m: pt.air.WindShear(pt.air.Inflow(m)), "inflow.memory", "rad"),
        (lambda m: pt.air.Inflow(pt.air.WindShear(m)), "wind_shear.exponent", "1"),
        (lambda m: pt.air.Inflow(pt.air.WindShear(m)), "polar.lift_amplitude", "1"),
        (lambda m: pt.air.WindShear(m, roughness=0.03), "wind_shear.roughness", "m"),
    ],
)
@pytest.mark.usefixtures("interpreted")
def test_models_on_models_are_made_again_with_their_numbers(robot, wrapped, name, unit):
    """They were found in a log, and then refused as no argument of the outermost model."""
    start = wrapped(pt.QuasiSteady(robot, GROUND))
    grey = pt.GreyBox(start, {name: 0.1})
    model, _ = grey.air_at(np.array([1.0]))
    values = dict(zip(model.parameter_names, model.parameters, strict=True))
    assert values.pop(name) == pytest.approx(grey.estimates(np.array([1.0]))[0].value)
    assert values.items() <= dict(zip(start.parameter_names, start.parameters, strict=True)).items()
    assert grey.estimates(np.zeros(1))[0].unit == unit


@pytest.mark.usefixtures("interpreted")
def test_viscosity_of_a_polar_is_found_in_a_flight(robot):
    """Slow air, Reynolds numbers of some 2000; the viscosity is twice that of air."""
    gait = pt.gaits.sinusoidal(robot, frequency=1.0, plunge=0.6, feather=0.5)
    true, believed = (
        pt.QuasiSteady(robot, pt.Air(wind=(-0.5, 0.0, 0.0)), polar=pt.air.ReynoldsPolar(**other))
        for other in ({"viscosity": 3e-5}, {})
    )
    flight = pt.simulate(robot, true, gait, duration=2.0, time_step=2e-3)
    grey = pt.GreyBox(believed, {"polar.viscosity": 1e-5})
    result = pt.identify(flight, pt.ExtendedLearner(grey, measurement_std=1e-4), every=5)
    value, std = (
        result.scores[f"parameter_{kind}"]["polar.viscosity"] for kind in ("value", "std")
    )
    # the filter linearizes its logarithm, at half of it to begin with
    assert value == pytest.approx(3e-5, rel=0.02) and std < 1e-6


@pytest.mark.usefixtures("interpreted")
def test_added_mass_is_part_of_y_or_not(robot):
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.6, feather=0.2)
    carried = pt.AddedMass(robot, AIR, factor=0.9)
    aero = pt.QuasiSteady(robot, AIR)
    flight = pt.simulate(robot, aero, gait, duration=0.1, time_step=1e-3, added_mass=carried)
    for added in (None, carried):
        grey = pt.GreyBox(aero, {"polar.lift_amplitude": 0.1}, added)
        assert grey.flight_terms[:2] == (added is not None,) * 2
        _, x, y, _ = samples(flight, grey)
        assert np.allclose(grey.evaluate(x, np.zeros(1)), y, atol=1e-12)  # rounding


@pytest.mark.parametrize("make", ["strips", "stall"])
@pytest.mark.usefixtures("interpreted")
def test_other_models_have_memory_too(make, robot, log):
    """DeLaurier's lags and those of stall settle where their derivatives vanish."""
    time, x = log
    models = {
        "strips": (pt.DeLaurier(robot, AIR), {"suction_efficiency": 0.1}),
        "stall": (
            pt.LiftingLine(robot, AIR, stall_delay=pt.air.StallDelay()),
            {"section.stall_begins": 0.05},
        ),
    }
    model, estimate = models[make]
    grey = pt.GreyBox(model, estimate)
    rows = network_inputs(grey, np.zeros(1), np.linspace(0, 5, 120), np.tile(x[3], (120, 1)))
    state = rows[-1, 6 : 6 + model.state_size]
    assert np.abs(model.state_derivative(x[3, :3], x[3, 3:], state)).max() < 1e-6  # relaxed
    row = network_inputs(grey, np.zeros(1), time, x)[50]
    expected = model.generalized_force(row[:3], row[3:6], row[6 : 6 + model.state_size])
    assert np.allclose(grey(row, np.zeros(1)), expected, rtol=1e-12)


def test_it_is_made_again(grey, log):
    for twin in (network_from_description(grey.describe()), pickle.loads(pickle.dumps(grey))):
        assert twin.describe() == grey.describe()
        rows = network_inputs(twin, np.zeros(3), *log)
        assert np.array_equal(rows, network_inputs(grey, np.zeros(3), *log))


def test_wandering_is_said_in_own_units(grey):
    assert grey.stds({"section.lift_slope": 0.005}) == pytest.approx([0, 0, 0.01])
    with pytest.raises(ParameterError, match="wandering"):
        grey.stds({"section.profile_drag": 0.1})
    for number in (-0.1, "0.1"):
        with pytest.raises(ParameterError, match="wandering"):
            grey.stds({"section.lift_slope": number})


def test_weights_of_another_box_are_refused(grey, robot):
    """Two weights of a box of three flew the third at its prior, and those of two named one."""
    weights, variances = np.array([0.5, -0.3, 1.2]), np.array([0.1, 0.2, 0.3])
    told = grey.estimates(weights, variances)
    assert grey.estimates([*weights], [*variances]) == told and len(told) == 3
    network = pt.learning.LinearStripNetwork(robot)
    for wrong in (weights[:2], np.append(weights, 0.0), weights[None]):
        for taker in (grey.estimates, grey.air_at, network.air_at):
            with pytest.raises(ShapeError, match="weights: expected shape"):
                taker(wrong)
    with pytest.raises(ShapeError, match="variances: expected shape"):
        grey.estimates(weights, np.diag(variances))
    with pytest.raises(ParameterError, match="variances: expected zero or more"):
        grey.estimates(weights, -variances)


@pytest.mark.parametrize(
    ("estimate", "options", "message"),
    [
        (
            {"section.lift_slop": 0.1},
            {},
            r"section.lift_slope, .*wing.mass.*closest: section.lift_slope",
        ),
        ({"lags.rate[2]": 0.1}, {}, "closest: lags.rate"),
        ({"section.lift_slope": 0.0}, {}, r"positive prior deviation \[1/rad\]"),
        ({}, {}, "estimate"),
        ({"added_mass.factor": 0.1}, {}, "added mass to go with it"),
        ({"density": 0.1}, {"start": "late"}, "start"),
        ({"density": 0.1}, {"measured": ["pitch"]}, "pitch"),
        ({"density": 0.1}, {"measured": ["plunge", "plunge"]}, "measured: expected different"),
        ({"density": 0.1}, {"measured": []}, "measured: expected different"),
    ],
)
def test_what_cannot_be_is_refused(robot, estimate, options, message):
    with pytest.raises(ParameterError, match=message):
        pt.GreyBox(pt.LiftingLine(robot, AIR), estimate, **options)


def test_a_number_that_cannot_be_zero_does_not_start_there(robot):
    plain = pt.LiftingLine(robot, AIR, section=pt.air.Section(profile_drag=0.0))
    with pytest.raises(ParameterError, match="above zero"):
        pt.GreyBox(plain, {"section.profile_drag": 0.01})
    other = pt.AddedMass(robot, pt.Air(density=1.0))
    with pytest.raises(ParameterError, match="added_mass.air"):
        pt.GreyBox(plain, {"density": 0.1}, other)


@pytest.mark.parametrize(
    ("name", "unit", "written"),
    [
        ("lags.rate[1]", "1/semichord", ""),
        ("wing[0].chord", "m", "m"),
        ("wing[0].quarter_chord.x", "m", "m"),
        ("wing.inertia.xy", "kg m^2", "kg m^2"),
        ("wind.y", "m/s", "m/s"),
        ("polar.lift_phase", "rad", "rad"),
        ("polar.lift_offset", "1", ""),
        ("polar.viscosity", "m^2/s", "m^2/s"),
        ("gravity", "m/s^2", "m/s^2"),
        ("feather.stiffness", "N m/rad", "N m/rad"),
        ("slide.stiffness", "N/m", "N/m"),
        ("slide.damping", "N s/m", "N s/m"),
        ("plunge.rest", "rad", "rad"),
    ],
)
def test_units(name, unit, written, robot):
    assert (unit_of(name, robot), written_unit(name, {name: 1.0}, robot)) == (unit, written)


@pytest.mark.usefixtures("interpreted")
def test_units_of_joints_are_those_of_their_kind(one_wing):
    """Units of joint stiffness were "N/m or N m/rad" in tables, reports and JSON."""
    robot = one_wing(
        "name: slide, type: prismatic, axis: z, stiffness: 5", "name: plunge, axis: x, stiffness: 5"
    )
    grey = pt.GreyBox(pt.QuasiSteady(robot, AIR), {f"{k}.stiffness": 0.1 for k in robot.dof_names})
    assert [one.unit for one in grey.estimates(np.zeros(2))] == ["N/m", "N m/rad"]


@pytest.mark.usefixtures("interpreted")
def test_a_robot_may_have_a_quaternion():
    """Its x is one longer, and forces are those of the same robot with angles."""
    source = pt.load_robot("aerobat").source.replace("strips: 5", "strips: 1")
    angles = load_robot_text(source)
    turned = angles.with_attitude("quaternion")
    estimate = {"polar.lift_amplitude": 0.1}
    boxes = [pt.GreyBox(pt.QuasiSteady(robot), estimate) for robot in (angles, turned)]
    assert boxes[1].inputs == boxes[0].inputs + 1
    v = angles.dof
    forces = []
    for box, robot in zip(boxes, (angles, turned), strict=True):
        q = robot.coordinates(left_plunge=0.3)
        x = np.concatenate([q, np.r_[4.0, np.zeros(v - 1)]])
        forces.append(box(x, np.ones(1)))
    assert np.abs(forces[0]).max() > 1e-3
    assert np.allclose(forces[1], forces[0], atol=1e-15)


def test_numbers_of_a_robot_are_found_from_a_flight_of_another_robot(robot, monkeypatch):
    """The flight carries the true robot, the model the one of the drawing, a third lighter."""
    truth = {"wing.mass": robot.bodies[-1].mass, "polar.lift_amplitude": 1.3}
    book = robot.with_parameters({"wing.mass": 0.67 * truth["wing.mass"]})
    polar = pt.air.DickinsonPolar(lift_amplitude=1.3)
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, feather=0.3)
    flight = pt.simulate(
        robot, pt.QuasiSteady(robot, AIR, polar=polar), gait, duration=0.4, time_step=1e-3
    )
    std = 0.02 * flight.aero_force.std("time").values
    noise = std * np.random.default_rng(0).normal(size=flight.u1.shape)
    network = pt.GreyBox(
        pt.QuasiSteady(book, AIR), {"wing.mass": 5e-4, "polar.lift_amplitude": 0.5}
    )
    learner = pt.ExtendedLearner(network, measurement_std=std)
    log = flight.assign(u1=flight.u1 + noise)
    pt.identify(log, learner, every=2)
    model = pt.refine(learner, log, every=2)
    for one in network.estimates(model.weights, np.diag(model.covariance)):
        assert abs(one.value - truth[one.name]) < 3 * one.std < 0.1 * truth[one.name]
    # A filter that ran away is no beginning: a drag of 5e47 +- 5e-4 came of one without a word.
    astray = learner.weights + 300.0
    monkeypatch.setattr(type(learner), "weights", property(lambda self: astray))
    np.testing.assert_allclose(pt.refine(learner, log, every=2).weights, model.weights, rtol=1e-3)


@pytest.mark.usefixtures("interpreted")
def test_the_force_is_that_by_the_numbers_of_the_robot_that_is_learned(one_wing):
    """The flown robot's dampers, and its inertia in measured forces, hid what was to be learned."""
    robot = one_wing("name: plunge, axis: x, damping: 1e-3", "name: feather, axis: -y")
    numbers = {"wing.mass": 1.3 * robot.bodies[-1].mass, "plunge.damping": 2e-3}
    true = robot.with_parameters(numbers)
    gait = pt.gaits.sinusoidal(true, frequency=5.0, plunge=0.5, feather=0.3)
    flight = pt.simulate(true, pt.QuasiSteady(true, AIR), gait, duration=0.2, time_step=1e-3)
    network = pt.GreyBox(pt.QuasiSteady(robot, AIR), {name: 1e-3 for name in numbers})
    weights = np.zeros(2)
    for k, one in enumerate(network.parameters):
        moved = numbers[one.name] - one.prior
        weights[k] = (np.log1p(moved / one.prior) if one.positive else moved) / one.scale
    time, x, y = pt.training_data(flight)
    q, v = np.split(x, 2, axis=1)
    spread, a = np.zeros((len(y), *[true.dof] * 2)), flight["a"].values
    forces = pt.sensing.ForceSamples(time, q, v, y, spread, true, "made", a=a)
    for given in (flight, forces):
        _, x, y, _ = samples(given, network)
        found = network.evaluate(x, weights)
        np.testing.assert_allclose(found, y, atol=1e-9 * np.abs(y).max())
    damped = pt.GreyBox(pt.QuasiSteady(robot, AIR), {"plunge.damping": 1e-3})
    with pytest.raises(ParameterError, match="a: expected accelerations"):
        samples(replace(forces, a=None), damped)


def test_the_wind_of_a_flight_is_taken_where_density_is_learned(robot):
    """A model of a learned density predicted in its old wind, and said nothing."""
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.5, feather=0.3)
    log = {
        speed: pt.simulate(
            robot,
            pt.QuasiSteady(robot, pt.Air(wind=(-speed, 0.0, 0.0), density=1.1)),
            gait,
            duration=0.3,
            time_step=1e-3,
        )
        for speed in (4.0, 6.0)
    }
    book = pt.QuasiSteady(robot, pt.Air(wind=(-4.0, 0.0, 0.0)))
    network = pt.GreyBox(book, {"density": 0.1})
    learner = pt.ExtendedLearner(network, measurement_std=1e-4)
    pt.identify(log[4.0], learner, every=4)
    found = pt.evaluate(log[6.0], model_of(learner))
    assert found.scores["nmse_worst"] < 1e-4
    assert "as learned, not of the flight: density" in str(found.scores["verdict"])


def test_a_drag_below_zero_is_told_where_it_was_fitted_and_refused_in_use(robot):
    air = pt.QuasiSteady(robot, pt.Air(), polar=pt.air.SmoothPolar())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.6)
    flight = pt.simulate(robot, air, gait, duration=0.02, time_step=1e-3)
    network = pt.GreyBox(air, {"polar.zero_lift_drag": 0.1, "polar.drag_rise": 1.0})
    scores = {}
    for drag in (0.1, -0.05):  # in place of 0.24
        model = Model(network, np.array([(drag - 0.24) / 0.1, 0.0]), None, None, None, {})
        scores[drag] = pt.evaluate(flight, model).scores["verdict"]
    assert not any("no flight" in word for word in scores[0.1])
    (told,) = [word for word in scores[-0.05] if "no flight" in word]
    assert "'polar.zero_lift_drag': -0.05" in told and "narrower priors" in told
    with pytest.raises(ParameterError, match="narrower priors"):
        model.air()


def test_an_inertia_that_no_body_has_is_told_where_it_was_fitted_and_refused_in_use(robot):
    """The filter may pass through it; a simulation with such an inertia ran without an error."""
    air = pt.QuasiSteady(robot, pt.Air())
    name = next(name for name in robot.parameter_names if name.endswith("wing.inertia.zz"))
    network = pt.GreyBox(air, {name: 1e-6})
    model = Model(network, np.array([5.0]), None, None, None, {})
    assert "narrower priors" in parameter_scores(model)["parameter_problem"]
    with pytest.raises(ParameterError, match="a possible robot.*principal moments"):
        model.air()


CLAMPED = """
name: clamped_wing
gravity: 9.81 m/s^2
bodies:
  wing:
    joints:
      - {name: plunge, axis: x}
      - {name: feather, axis: -y}
    mass: 6 g
    center_of_mass: [-12 mm, 70 mm, 2 mm]
    inertia: {xx: 90 g cm^2, yy: 12 g cm^2, zz: 101 g cm^2}
wings:
  - name: wing
    segments:
      - {body: wing, strips: 4, stations: [{span: 1 cm, leading: 2 cm, trailing: -6 cm},
         {span: 20 cm, leading: 1.5 cm, trailing: -4 cm}]}
"""


def test_the_noise_of_a_small_robot_is_found(rng):
    """It began at a hundredth of 1 N m whatever the robot: 400 times that of a feathering."""
    robot = load_robot_text(CLAMPED, "clamped")
    truth = pt.QuasiSteady(robot, AIR, polar=pt.air.DickinsonPolar(drag_offset=2.2))
    gait = pt.gaits.sinusoidal(robot, frequency=4.0, plunge=0.6, feather=0.35)
    flight = pt.simulate(robot, truth, gait, duration=3.0, time_step=1e-3)
    noise = 0.05 * flight.aero_force.std("time").values
    noisy = flight.u1 + noise * rng.normal(size=flight.u1.shape)
    grey = pt.GreyBox(pt.QuasiSteady(robot, AIR), {"polar.drag_offset": 0.5})
    learner = pt.ExtendedLearner(grey)
    pt.identify(flight.assign(u1=noisy.assign_attrs(flight.u1.attrs)), learner, every=10)
    found = learner.measurement_std / noise
    assert ((found > 0.7) & (found < 1.5)).all(), found  # of 300 samples, a start at twice that
