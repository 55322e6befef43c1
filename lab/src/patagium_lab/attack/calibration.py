"""Calibration: coverage of the 95 % interval, and the innovations of the filter.

Every sample of a flight is learned, as it is and with noise, and every sample of a real log.
Neglected: noise that is not white.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from patagium.learning.identify import identify
from patagium.learning.learners.cubature import CubatureLearner
from patagium.learning.settings import NoiseEstimation
from patagium.learning.stream import stream
from patagium.learning.table_network import network_for
from patagium.robot import load_robot
from patagium.sensing.force.air_force import training_data
from patagium.sensing.logs.importing.import_log import read_table
from patagium_lab.measured.crazyflie import (
    HIDDEN,
    MEASUREMENT_STD,
    crazyflie_mapping,
    in_flight,
)
from patagium_lab.reproduction.cases import (
    FLIGHT_CASES,
    SPREAD,
    WEIGHT_STD,
    lever_arms,
    make_network,
)
from patagium_lab.reproduction.flights import corrected_flight

NOISES = (0.0, 0.02, 0.1)
"""Standard deviations of the noise added to a flight, over those of each output [1]."""
DURATION = 1.0
"""Duration of the flight [s]."""
LOWEST, HIGHEST = 0.93, 0.97
"""Coverage that counts as calibrated."""


def flight_calibration(noise: float, duration: float = DURATION) -> dict[str, Any]:
    """The strip network on the corrected flight, noise found online.

    Args:
        noise: Standard deviation of the added noise over that of each output [1].
        duration: Duration of the flight [s].

    Returns:
        See `log_calibration`.
    """
    time, x, y = training_data(corrected_flight(duration))
    y = y + noise * y.std(axis=0) * np.random.default_rng(0).normal(size=y.shape)
    subject = FLIGHT_CASES["corrected"]
    network = make_network(subject, "strip")
    learner = CubatureLearner(
        network,
        prior_std=WEIGHT_STD * np.sqrt(network.fan_in),
        measurement_std=subject.strip_std * lever_arms(load_robot(subject.robot)),
        spread=SPREAD,
        noise_estimation=NoiseEstimation(600),
    )
    scores = stream(learner, time, x, y, every=1).scores
    name = f"corrected flight, {noise:.0%} noise" if noise else "corrected flight"
    return _row(f"{name}, strip network", scores)


def log_calibration(path: str | Path) -> dict[str, Any]:
    """A dense network on the quadrotor's log in flight, noise found online.

    Args:
        path: The log, `log16.csv.gz`.

    Returns:
        subject; samples; coverage, of the 95 % interval, all and second half; calibrated;
        nis_per_channel and nis_inside; innovation_correlation, mean over outputs; reliability,
        nominal probability to share inside; nmse of the second half, mean.
    """
    table = in_flight(read_table(path, crazyflie_mapping()))
    learner = CubatureLearner(
        network_for(table, HIDDEN),
        prior_std=0.5,
        measurement_std=MEASUREMENT_STD,
        spread=SPREAD,
        prior_share=1e-5,
        noise_estimation=NoiseEstimation(300),
    )
    scores = identify(table, learner, every=1).scores
    return _row("Crazyflie log in flight, dense network", scores)


def _row(subject: str, scores: dict[str, Any]) -> dict[str, Any]:
    color = np.array(list(scores["innovation_correlation"].values()), float)
    return {
        "subject": subject,
        "samples": scores["updates"],
        "outcome": scores["outcome"],
        "coverage": scores["coverage"],
        "coverage_second_half": scores["coverage_second_half"],
        "calibrated": LOWEST <= scores["coverage"] <= HIGHEST,
        "nis_per_channel": scores["nis_per_channel"],
        "nis_inside": scores["nis_inside"],
        "innovation_correlation": float(np.nanmean(color)),
        "reliability": {name: float(share) for name, share in scores["reliability"].items()},
        "nmse": scores["nmse_second_half_mean"],
    }
