import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import patagium as pt
from patagium.errors import LogError, ParameterError, ShapeError
from patagium.learning.default_learner import learner_choices
from patagium.learning.filters.weight_covariance import block_covariance
from patagium.learning.identify import compare
from patagium.learning.model_file import Model, load_model, model_of, save_model
from patagium.learning.stream import stream


def taught(rng: np.random.Generator, **options: Any) -> pt.CubatureLearner:
    network = pt.DenseNetwork(3, (4,), ("lift", "drag"), input_scale=2.0, output_center=0.1)
    setting = {"prior_std": 0.5, "measurement_std": (0.1, 0.3), "spread": 0.2}
    learner = pt.CubatureLearner(network, **setting, **options)
    for x in rng.normal(size=(30, 3)):
        learner.update(x, [x[0], x[1] * x[2]])
    return learner


def test_a_model_comes_back_bit_for_bit(tmp_path: Path, rng: np.random.Generator) -> None:
    learner = taught(rng)
    model = model_of(learner, inputs=("a", "b", "c"), source="thirty samples")
    assert save_model(tmp_path / "model.json", model).name == "model.json"
    again = load_model(tmp_path / "model.json")
    np.testing.assert_array_equal(again.weights, learner.weights)
    assert again.covariance is not None
    np.testing.assert_allclose(again.covariance, learner.covariance, rtol=0, atol=1e-18)  # symmetry
    assert again.network.describe() == learner.network.describe()
    assert again.inputs == ("a", "b", "c") and again.source == "thirty samples"
    assert again.learner["kind"] == "cubature" and again.learner["spread"] == 0.2
    assert [file.name for file in tmp_path.iterdir()] == ["model.json"]


def test_a_model_predicts_as_its_learner_did(tmp_path: Path, rng: np.random.Generator) -> None:
    learner = taught(rng)
    save_model(tmp_path / "model.json", learner)
    model = load_model(tmp_path / "model.json")
    x = rng.normal(size=3)
    mean, covariance = model.predict(x)
    expected_mean, expected = learner.predict(x)
    # the learner sees the curvature at a spread of 0.2; the model is linear
    np.testing.assert_allclose(mean, expected_mean, atol=0.02)
    np.testing.assert_allclose(covariance, expected, atol=0.05 * np.abs(expected).max())
    np.testing.assert_array_equal(mean, learner.network(x, learner.weights))


def test_an_output_that_was_never_measured_takes_no_interval_of_the_others(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """The model lost the noise of all outputs, the score its intervals; the page said "nan %"."""
    x, time = rng.normal(size=(400, 2)), 0.01 * np.arange(400.0)
    y = np.column_stack([x[:, 0] + 0.1 * rng.normal(size=400), np.full(400, np.nan)])
    network = pt.DenseNetwork(2, (), ("lift", "drag"))
    learner = pt.ExtendedLearner(network, misfit=pt.learning.Misfit())
    stream(learner, time, x, y, every=1)
    model = load_model(save_model(tmp_path / "model.json", learner))
    assert model.measurement_std is not None and model.learner["found"]["measurement_std"][0] > 0
    np.testing.assert_array_equal(model.measurement_std[0], learner.measurement_std[0])
    assert model.measurement_std[1] == 0.0 and learner_choices(learner, given=())["noise"]
    later = compare(model, time, x, y)
    assert later.scores["coverage_by_output"]["lift"] == pytest.approx(0.95, abs=0.1)  # it was NaN
    assert later.scores["not_measured"] == ["drag"]
    later.report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Not measured, and left out of mean and worst: drag." in page and "Silent" not in page


def test_a_page_says_that_a_share_is_not_known(tmp_path: Path, rng: np.random.Generator) -> None:
    """A report showed an unknown coverage as "nan %"."""
    x, time = rng.normal(size=(100, 2)), 0.01 * np.arange(100.0)
    network = pt.DenseNetwork(2, (), ("lift",))
    model = Model(network, network.initial(0))
    compare(model, time, x, x[:, :1]).report(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "nan %" not in page and "n/a" in page


@pytest.mark.parametrize("count", [0, 1, 4])
def test_several_inputs_are_predicted_as_one_by_one(count: int, rng: np.random.Generator) -> None:
    learner, x = taught(rng), rng.normal(size=(count, 3))
    for one in (learner, model_of(learner)):
        mean, covariance = one.predict(x)
        assert mean.shape == (count, 2) and covariance.shape == (count, 2, 2)
        for k, row in enumerate(x):
            np.testing.assert_array_equal(mean[k], one.predict(row)[0])
            np.testing.assert_array_equal(covariance[k], one.predict(row)[1])
        with pytest.raises(ShapeError, match="x"):
            one.predict(np.zeros((2, 4)))


STRUCTURES = {
    "node": {"covariance": "node"},
    "layer": {"covariance": "layer"},
    "algorithm 1": {"square_root": "cholesky"},
    "single": {"dtype": "float32"},
}


@pytest.mark.parametrize("options", STRUCTURES.values(), ids=STRUCTURES)
def test_a_structured_covariance_is_kept_as_it_is(
    options: dict[str, Any], tmp_path: Path, rng: np.random.Generator
) -> None:
    learner = taught(rng, **options)
    save_model(tmp_path / "model.json", learner)
    model = load_model(tmp_path / "model.json")
    kept = model.kept_covariance
    assert kept is not None and model.covariance is not None
    size = np.abs(learner.covariance).max()
    np.testing.assert_allclose(model.covariance, learner.covariance, atol=1e-14 * size)  # rounding
    np.testing.assert_allclose(kept.variances(), learner.variances, rtol=1e-12)  # rounding
    x = rng.normal(size=3)
    _, slope = learner.network.linearized(learner.network.encode_one(x), learner.weights)
    expected = slope @ learner.covariance @ slope.T + np.diag([0.1**2, 0.3**2])
    np.testing.assert_allclose(model.predict(x)[1], expected, rtol=1e-9, atol=1e-15)  # rounding


def test_a_model_knows_the_noise_its_learner_found(rng: np.random.Generator) -> None:
    learner = taught(rng, noise_estimation=pt.learning.NoiseEstimation(memory=10))
    std = model_of(learner).measurement_std
    np.testing.assert_array_equal(std, learner.measurement_std)
    assert np.abs(std - [0.1, 0.3]).max() > 0.01


def test_many_weights_never_become_a_matrix(tmp_path: Path, rng: np.random.Generator) -> None:
    network = pt.DenseNetwork(40, (500,), 2)
    learner = pt.CubatureLearner(network, prior_std=0.5, measurement_std=0.1, covariance="node")
    model = load_model(save_model(tmp_path / "model.json", learner))
    assert (tmp_path / "model.json").stat().st_size < 12e6  # n^2 numbers: 3.7 GB
    mean, spread = model.predict(rng.normal(size=40))
    assert np.isfinite(mean).all() and (np.diag(spread) > 0.01).all()
    with pytest.raises(ParameterError, match="at most 5000 weights"):
        _ = model.covariance


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ({"kind": "full", "lower": ""}, "lower triangles"),
        ({"kind": "round", "lower": ""}, "round"),
        ({"kind": "node"}, "lower"),
    ],
)
def test_a_covariance_that_does_not_fit_is_refused(
    covariance: dict[str, str], message: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    save_model(tmp_path / "model.json", taught(rng))
    words = json.loads((tmp_path / "model.json").read_text()) | {"covariance": covariance}
    (tmp_path / "model.json").write_text(json.dumps(words))
    with pytest.raises(LogError, match=message):
        load_model(tmp_path / "model.json")


def test_without_a_covariance_the_deviation_is_unknown(rng: np.random.Generator) -> None:
    network = pt.DenseNetwork(2, (), 1)
    mean, covariance = Model(network, np.zeros(3)).predict([1.0, 2.0])
    assert mean.shape == (1,) and np.isnan(covariance).all()


def test_weights_of_another_network_are_refused() -> None:
    network = pt.DenseNetwork(2, (), 1)
    with pytest.raises(ShapeError, match="weights"):
        Model(network, np.zeros(4))
    with pytest.raises(ShapeError, match="covariance"):
        other = pt.DenseNetwork(1, (), 1)
        Model(network, np.zeros(3), block_covariance(other, "full", [np.eye(2)]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "expected JSON"),
        ("[]", "expected a JSON object"),
        ('{"format": "patagium model 9"}', "found 'patagium model 9'"),
        ('{"format": "patagium model 2"}', "cannot be made again"),
    ],
)
def test_files_that_are_no_models(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(LogError, match=message):
        load_model(tmp_path / "model.json")


@pytest.mark.parametrize("key", ["weights", "measurement_std"])
@pytest.mark.parametrize("odd", [True, "1"])
def test_only_numbers_of_a_model_are_numbers(
    tmp_path: Path, rng: np.random.Generator, key: str, odd: Any
) -> None:
    """True and the text '1' were taken for 1."""
    words = json.loads(save_model(tmp_path / "model.json", taught(rng)).read_text())
    words[key][0] = odd
    (tmp_path / "model.json").write_text(json.dumps(words))
    with pytest.raises(LogError, match=f"{key}: expected real numbers"):
        load_model(tmp_path / "model.json")


def test_a_wind_of_true_is_refused() -> None:
    """A list of True and numbers is one of numbers to NumPy: it was a wind of 1 m/s."""
    with pytest.raises(ParameterError, match="wind: expected "):
        pt.Air(wind=(True, 0.0, 0.0))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.json: .*found no such file"):
        load_model(tmp_path / "none.json")


def test_a_format_that_is_long_is_not_repeated(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"format": ["patagium"] * 10_000}))
    with pytest.raises(LogError, match="expected a file of format") as refused:
        load_model(path)
    assert len(str(refused.value)) < 1000


def test_an_identification_has_the_model_that_is_saved(tmp_path: Path) -> None:
    flight = pt.simulate(pt.load_robot("aerobat"), duration=0.1, time_step=1e-3)
    result = pt.identify(flight)
    again = load_model(save_model(tmp_path / "model.json", result.model))
    x = np.concatenate([flight[k][-1] for k in "qva"])
    np.testing.assert_array_equal(again.predict(x)[0], result.model.predict(x)[0])
    assert pt.evaluate(flight, result.model).model is not None
    assert again != result.model and len({again, result.model}) == 2
    result.save(tmp_path / "result.nc")
    assert result.model.inputs is None
    names = [f"{part}.{name}" for part in "qv" for name in pt.load_robot("aerobat").dof_names]
    network = pt.DenseNetwork(len(names), (3,), ("z",))
    learner = pt.CubatureLearner(network, prior_std=0.3, measurement_std=0.1, spread=1.7)
    assert pt.identify(flight, learner, inputs=names[::-1]).model.inputs == tuple(names[::-1])
    with pytest.raises(ParameterError, match="learner"):
        _ = pt.learning.load_identification(tmp_path / "result.nc").model
