"""Physical parameters of an identification: their table, and their paths from update to update."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import xarray as xr

from patagium.arrays import Array
from patagium.errors import ParameterError
from patagium.learning.model_file import Model
from patagium.learning.models.network import Network
from patagium.learning.models.physical import Estimate
from patagium.report import Table

_FIELDS = {
    "unit": "unit",
    "value": "value",
    "std": "standard deviation",
    "prior": "prior",
    "prior_std": "its standard deviation",
}
"""Columns of the table of parameters, by field of an `Estimate`."""


@runtime_checkable
class Trained(Protocol):
    """Network with its weights: a learner, or a model from a file."""

    @property
    def network(self) -> Network:
        """Network that predicts."""

    @property
    def weights(self) -> Array:
        """Weights of the network, (n,)."""


def estimates_of(trained: Trained) -> tuple[Estimate, ...]:
    """Physical parameters as a learner or a model from a file knows them; may be none."""
    estimates: Any = getattr(trained.network, "estimates", None)
    if estimates is None:
        return ()
    variances = getattr(trained, "variances", None)
    if isinstance(trained, Model) and trained.kept_covariance is not None:
        variances = trained.kept_covariance.variances()
    found: tuple[Estimate, ...] = estimates(trained.weights, variances)
    return found


def parameter_scores(trained: Trained) -> dict[str, Any]:
    """Physical parameters as JSON values: parameter_value, ... by name of the parameter.

    `parameter_problem` says why no model of the air has these weights, `parameter_fit` how they
    were found; each is missing where there is nothing to say.
    """
    estimates, network, told = estimates_of(trained), trained.network, {}
    try:
        if hasattr(network, "air_at"):
            Model(network, trained.weights).air()
    except ParameterError as refused:
        told["parameter_problem"] = str(refused)
    if not estimates:
        return told
    if isinstance(trained, Model) and "parameter_fit" in trained.learner:
        told["parameter_fit"] = trained.learner["parameter_fit"]
    return told | {
        f"parameter_{field}": {found.name: getattr(found, field) for found in estimates}
        for field in _FIELDS
    }


def parameter_paths(estimates: Sequence[Sequence[Estimate]]) -> dict[str, xr.DataArray]:
    """Parameters after each update, (update_time, parameter), in their units."""
    if not estimates or not estimates[0]:
        return {}
    names, units = ([getattr(found, k) for found in estimates[0]] for k in ("name", "unit"))
    return {
        f"parameter_{field}": xr.DataArray(
            [[getattr(found, field) for found in step] for step in estimates],
            dims=("update_time", "parameter"),
            coords={"parameter": names, "parameter_unit": ("parameter", units)},
        )
        for field in ("value", "std")
    }


def parameter_table(scores: Mapping[str, Any]) -> Table | None:
    """Table of the parameters and of what was known of them before; None where there are none."""
    if "parameter_value" not in scores:
        return None
    rows = [
        [name, *(scores[f"parameter_{field}"][name] for field in _FIELDS)]
        for name in scores["parameter_value"]
    ]
    found = scores.get("parameter_fit", "one pass, which may be far too sure of them")
    words = f"Physical parameters, from {found}, and before any sample."
    return Table(["parameter", *_FIELDS.values()], rows, words)
