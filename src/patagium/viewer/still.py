"""A moment of a flight as a picture in perspective, without a browser."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from patagium.errors import ParameterError
from patagium.report.still import OBLIQUE, draw_still
from patagium.viewer.predicted_forces import Predicted
from patagium.viewer.replay import replay_content


def still(
    flight: xr.Dataset,
    time: float | None = None,
    *,
    predicted: Predicted | None = None,
    seen_from: tuple[float, float, float] = OBLIQUE,
) -> Figure:
    """A moment of a flight in perspective: what the replay page shows, as a drawing.

    Bodies and wings, the force of the air on each strip (a predicted one as a halo around it),
    the path and what the wing tips traced in the last wingbeat.

    Args:
        flight: The flight.
        time: When [s]; None: in the middle of the flight.
        predicted: A learner or model, or the identification of this flight; see `replay`.
        seen_from: Direction from the robot to the eye, world axes, (3,) [-].

    Returns:
        A figure, to be saved as .png, .svg or .pdf.

    Raises:
        FlightError: If the flight does not carry its robot.
        ParameterError: If the time is not within the flight, or the eye straight above.
    """
    first, last = float(flight["time"][0]), float(flight["time"][-1])
    when = (first + last) / 2 if time is None else float(time)
    if not first <= when <= last:
        raise ParameterError("time", f"within {first:g} to {last:g} s", f"{when:g} s")
    if not np.hypot(*seen_from[:2]) > 0:
        raise ParameterError("seen_from", "a direction that is not straight up", seen_from)
    shown = replay_content(flight, predicted)
    return draw_still(shown, int(np.abs(shown.time - when).argmin()), seen_from=seen_from)
