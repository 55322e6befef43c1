"""A flight as a film: pictures of a span of it one after another, as GIF or MP4.

Neglected: sound, and a camera that moves otherwise than with the robot.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from PIL import Image

from patagium.arguments import Progress
from patagium.errors import ParameterError
from patagium.report.replay_page import Replay
from patagium.report.still import draw_still, room_of
from patagium.viewer.predicted_forces import Predicted
from patagium.viewer.replay import replay_content
from patagium.whole_file import whole_file

PICTURES, RATE = 48, 20
"""Pictures of a film, and pictures a second as it is shown."""
_DOTS = 110  # 1/inch


def film(
    flight: xr.Dataset,
    path: str | Path,
    *,
    predicted: Predicted | None = None,
    start: float | None = None,
    end: float | None = None,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Film of a span of a flight in slow motion, seen as in `still`.

    Args:
        flight: The flight.
        path: File ending in .gif, or in .mp4, which needs patagium[film].
        predicted: A learner or model, or the identification of this flight; see `replay`.
        start: First time shown [s]; None: the flight's first.
        end: Last time shown [s]; None: the flight's last.
        progress: Receives the pictures done and all of them.

    Raises:
        FlightError: If the flight does not carry its robot.
        ParameterError: If the name ends otherwise, the span holds no two samples, or what writes
            MP4 is not installed.
        OutputError: If the file cannot be written.
    """
    kind = Path(path).suffix.lower()
    write = {".gif": _write_gif, ".mp4": _write_mp4}.get(kind)
    if write is None:
        raise ParameterError("film", "a name ending in .gif or .mp4", Path(path).name)
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ParameterError("film", ".gif, or patagium[film] for .mp4", "no imageio-ffmpeg")
    shown = replay_content(flight, predicted, None, start, end)
    with whole_file(path) as draft:
        write(draft, _pictures(shown, progress))
    return Path(path)


def _pictures(shown: Replay, progress: Progress) -> Iterator[NDArray[np.uint8]]:
    """Pictures with even numbers of dots, each (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    count = min(PICTURES, len(shown.time))
    frames = [int(k) for k in np.linspace(0, len(shown.time) - 1, count)]
    room = room_of(shown, frames[::4])
    for done, frame in enumerate(frames):
        figure = draw_still(shown, frame, room=room)
        figure.set_dpi(_DOTS)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        dots = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
        yield np.ascontiguousarray(dots[: len(dots) // 2 * 2, : dots.shape[1] // 2 * 2])
        progress(done + 1, count)


def _write_gif(draft: Path, pictures: Iterator[NDArray[np.uint8]]) -> None:
    first, *others = (Image.fromarray(one).quantize(128) for one in pictures)
    first.save(draft, "GIF", save_all=True, append_images=others, duration=1000 // RATE, loop=0)


def _write_mp4(draft: Path, pictures: Iterator[NDArray[np.uint8]]) -> None:
    import imageio_ffmpeg

    first = next(pictures)
    video = imageio_ffmpeg.write_frames(
        str(draft), first.shape[1::-1], fps=RATE, macro_block_size=2, output_params=["-f", "mp4"]
    )
    video.send(None)
    for one in (first, *pictures):
        video.send(one)
    video.close()
