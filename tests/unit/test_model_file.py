from pathlib import Path

import numpy as np
import pytest

import patagium as pt
from patagium.errors import LogError, ShapeError
from patagium.identification.model_file import Model, load_model, model_of, save_model


def taught(rng: np.random.Generator) -> pt.CubatureLearner:
    network = pt.DenseNetwork(3, (4,), ("lift", "drag"), input_scale=2.0, output_center=0.1)
    learner = pt.CubatureLearner(
        network, prior_deviation=0.5, measurement_deviation=(0.1, 0.3), spread=0.2
    )
    for x in rng.normal(size=(30, 3)):
        learner.update(x, [x[0], x[1] * x[2]])
    return learner


def test_a_model_comes_back_bit_for_bit(tmp_path: Path, rng: np.random.Generator) -> None:
    learner = taught(rng)
    model = model_of(learner, inputs=("a", "b", "c"), source="thirty samples")
    assert save_model(tmp_path / "new" / "model.json", model).name == "model.json"
    again = load_model(tmp_path / "new" / "model.json")
    np.testing.assert_array_equal(again.weights, learner.weights)
    assert again.covariance is not None
    np.testing.assert_allclose(again.covariance, learner.covariance, rtol=0, atol=1e-18)  # symmetry
    assert again.network.describe() == learner.network.describe()
    assert again.inputs == ("a", "b", "c") and again.source == "thirty samples"
    assert again.learner["kind"] == "cubature" and again.learner["spread"] == 0.2
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["model.json"]


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


def test_without_a_covariance_the_deviation_is_unknown(rng: np.random.Generator) -> None:
    network = pt.DenseNetwork(2, (), 1)
    mean, covariance = Model(network, np.zeros(3)).predict([1.0, 2.0])
    assert mean.shape == (1,) and np.isnan(covariance).all()


def test_weights_of_another_network_are_refused() -> None:
    network = pt.DenseNetwork(2, (), 1)
    with pytest.raises(ShapeError, match="weights"):
        Model(network, np.zeros(4))
    with pytest.raises(ShapeError, match="covariance"):
        Model(network, np.zeros(3), np.eye(2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "expected a model"),
        ("[]", "found 'list'"),
        ('{"format": "patagium model 9"}', "found 'patagium model 9'"),
        ('{"format": "patagium model 1"}', "cannot be made again"),
    ],
)
def test_files_that_are_no_models(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(LogError, match=message):
        load_model(tmp_path / "model.json")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.json: cannot be read"):
        load_model(tmp_path / "none.json")
