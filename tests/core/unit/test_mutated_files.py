"""Mutated files of every kind are read, or refused with a PatagiumError."""

import hashlib
from contextlib import suppress

import numpy as np
import pytest
import xarray as xr
from tests.mutations import mutated_attributes, mutated_bytes, mutated_json, mutated_text

import patagium as pt
from patagium.errors import LogError, ParameterError, PatagiumError
from patagium.learning.learners.extended import ExtendedLearner
from patagium.learning.learners.registry import load_learner
from patagium.learning.model_file import load_model, save_model
from patagium.learning.models.dense import DenseNetwork
from patagium.live.packets import DatagramPackets, Intake, TextPackets
from patagium.robot import load_robot_text
from patagium.robot.files import preset_text
from patagium.sensing.logs.mapping import load_mapping
from patagium.simulation.flight import added_mass_of, aero_of, carrier_of, gait_period, robot_of
from patagium.simulation.gait_models import read_columns

_CASES = 60


@pytest.fixture(scope="module")
def learner():
    made = ExtendedLearner(DenseNetwork(2, (3,), 2), measurement_std=0.1)
    for k in range(5):
        made.update(np.array([0.1 * k, 1.0]), np.array([0.2, 0.1 * k]))
    return made


@pytest.fixture(scope="module")
def flight():
    robot = pt.load_robot("aerobat")
    air = pt.air.QuasiSteady(robot, pt.Air())
    gait = pt.gaits.sinusoidal(robot, frequency=5.0, plunge=0.3)
    mount = pt.mounts.fixed()
    return pt.simulate(robot, air, gait, duration=0.01, time_step=1e-3, mount=mount)


def _only_ours(read, content, rng_seed, mutate):
    for case in range(_CASES):
        rng = np.random.default_rng((rng_seed, case))
        changed = mutate(content, rng)
        with suppress(PatagiumError):
            read(changed)


def test_robot_texts():
    _only_ours(load_robot_text, preset_text("aerobat"), 1, mutated_text)


def test_model_files(learner, tmp_path):
    file = tmp_path / "m.json"
    save_model(file, learner)
    text = file.read_text()

    def read(changed):
        file.write_text(changed, "utf-8")
        load_model(file).predict(np.zeros(2))

    _only_ours(read, text, 2, mutated_json)


def test_learner_files_with_a_right_digest(learner, tmp_path):
    file = tmp_path / "l"
    learner.save(file)
    kind, _, rest = file.read_bytes().split(b"\n", 2)
    header, _, numbers = rest.partition(b"\n")

    def read(changed):
        content = changed.encode("utf-8", "surrogatepass") + b"\n" + numbers
        digest = hashlib.sha256(content).hexdigest().encode()
        file.write_bytes(kind + b"\n" + digest + b"\n" + content)
        load_learner(file)

    _only_ours(read, header.decode(), 3, mutated_json)


def test_attributes_of_flights(flight):
    def read(attributes):
        changed = flight.assign_attrs()
        changed.attrs = attributes
        for made in (robot_of, aero_of, added_mass_of, gait_period, carrier_of):
            with suppress(PatagiumError):
                made(changed)

    _only_ours(read, dict(flight.attrs), 4, mutated_attributes)


def test_bytes_of_netcdf_files(flight, tmp_path):
    file = tmp_path / "f.nc"
    pt.save_flight(flight, file)

    def read(changed):
        file.write_bytes(changed)
        pt.load_flight(file)

    _only_ours(read, file.read_bytes(), 5, mutated_bytes)


def test_tables(tmp_path):
    file = tmp_path / "t.csv"

    def read(changed):
        file.write_bytes(changed)
        read_columns(file, lambda _: "rad")

    _only_ours(read, b"time [s],plunge [rad]\n0,1\n0.1,2\n0.2,3\n", 6, mutated_bytes)


def test_mappings(tmp_path):
    file = tmp_path / "m.yaml"
    text = "time: {column: t, unit: s}\ninputs:\n- {column: a, unit: m/s^2}\noutputs: []\n"

    def read(changed):
        file.write_text(changed)
        load_mapping(file)

    _only_ours(read, text, 7, mutated_text)


def test_packets():
    line = b"time,a\n0,1\n0.1,2\n"
    _only_ours(lambda k: TextPackets(("time", "a"), Intake()).take(k), line, 8, mutated_bytes)
    datagram = np.array([1.0, 0.0, 0.1, 2.0]).tobytes()
    _only_ours(lambda k: DatagramPackets(2, Intake()).take(k), datagram, 9, mutated_bytes)


@pytest.mark.parametrize(
    "values",
    [[1j, 0], np.ma.masked_array([1.0, 2.0], [0, 1]), ["1", "2"], ["a", "b"], [None, 1.0],
     np.array(["2020-01-01", "2020-01-02"], "datetime64[s]"), [[1], [1, 2]], {}],
)  # fmt: skip
def test_only_real_numbers_are_learned(learner, values):
    with pytest.raises(ParameterError, match="x: expected real numbers"):
        learner.update(values, np.zeros(2))
    with pytest.raises(ParameterError, match="y: expected real numbers"):
        learner.update(np.zeros(2), values)


def test_a_flight_in_place_of_samples_is_told_where_it_is_taken(learner):
    """A flight given as numbers was refused with xarray's own advice on conversions."""
    with pytest.raises(ParameterError, match="pt.evaluate.*found 'a Dataset'$"):
        learner.predict(xr.Dataset({"q": ("time", [1.0])}))


def test_deviations_of_another_length_are_refused_when_the_model_is_read(learner, tmp_path):
    file = tmp_path / "m.json"
    save_model(file, learner)
    text = file.read_text()
    start = text.index('"measurement_std": [')
    end = text.index("]", start) + 1
    file.write_text(text[:start] + '"measurement_std": [0.1, 0.1, 0.1]' + text[end:])
    with pytest.raises(LogError, match="measurement_std"):
        load_model(file)


@pytest.mark.parametrize(("name", "value"), [("input_scale", "1e-320"), ("input_center", "1e308")])
def test_scales_beyond_physics_are_refused(learner, tmp_path, name, value):
    file = tmp_path / "m.json"
    save_model(file, learner)
    text = file.read_text()
    start = text.index(f'"{name}": [')
    end = text.index("]", start)
    file.write_text(text[:start] + f'"{name}": [{value}, {value}' + text[end:])
    with pytest.raises(LogError, match=name):
        load_model(file)


def test_shapes_beyond_memory_are_refused(learner, tmp_path):
    file = tmp_path / "l"
    learner.save(file)
    kind, _, rest = file.read_bytes().split(b"\n", 2)
    changed = rest.replace(b'["<f8", [', b'["<f8", [' + b"1" + b"0" * 29 + b", ", 1)
    digest = hashlib.sha256(changed).hexdigest().encode()
    file.write_bytes(kind + b"\n" + digest + b"\n" + changed)
    with pytest.raises(LogError, match="cannot be made again"):
        load_learner(file)
