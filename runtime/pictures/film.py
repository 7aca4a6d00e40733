"""A moving picture of a recording, as a GIF: for a page or a talk. Each instant is drawn as `stills` draws it."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.runtime.pictures.stills import Scene, legend, rows_at, title
from srl.runtime.recording.reader import Recording

SIZE = (4.0, 4.4)  # inches
DOTS = 100  # per inch
RATE = 12.5  # pictures per second
TICK = 0.01  # s, in which a GIF counts; browsers show what is shorter than two of them slowly
MOST = 1500  # pictures; all are in memory until the end
COLOURS = 256  # the same for all pictures: what stands still then costs nothing


def draw(
    recording: Recording,
    gif: Path,
    between: tuple[float, float] | None = None,
    rate: float = RATE,
    show: tuple[str, ...] = (),
    side: str | None = None,
) -> tuple[int, float]:
    """Draws the newest row at each picture's time; the camera stands still.

    Args:
        recording: what is drawn.
        gif: where.
        between: begin and end, s from the first row; None: from the first to the last row in which the limb was active,
            or all rows if it never was.
        rate: pictures per second. The time between two is rounded to what a GIF can say.
        show, side: as for `Scene`.
    Returns:
        How many pictures there are, and the seconds between two of them.
    Raises:
        RecordingError: nothing has a shape, the times lie outside, too many pictures, it can't be written.
    """
    scene = Scene(recording, show, side)
    begin, end = between or _active(recording)
    if not begin < end:
        raise RecordingError("--between", f"{begin:g} s isn't before {end:g} s", "Give the begin, then the end")
    period = max(2, round(1.0 / (rate * TICK))) * TICK
    times = begin + period * np.arange(int((end - begin) / period + 1e-6) + 1)
    if len(times) > MOST:
        raise RecordingError(
            "--film", f"{end - begin:.0f} s are {len(times)} pictures, more than {MOST}",
            "Give --between BEGIN END, or a lower --rate",
        )  # fmt: skip
    rows = rows_at(recording, [*times.tolist(), end], "--between")[: len(times)]
    shapes = [scene.of(row) for row in rows]
    middle, reach = _whole(*scene.frame(shapes))
    figure, axis = plt.subplots(figsize=SIZE, dpi=DOTS, layout="constrained")
    pictures: list[Image.Image] = []
    try:
        legend(figure, scene.things, 3)
        for t, row, shape in zip(times, rows, shapes, strict=True):
            axis.clear()
            axis.axis("off")
            late = "" if int(recording.layout.header(row, "state")) == State.ACTIVE else ", no law runs"
            axis.set_title(f"{title(recording)}, {t:.1f} s{late}", fontsize=9)
            scene.paint(axis, shape, middle, reach)
            figure.canvas.draw()
            if t == times[0]:
                figure.set_layout_engine("none")  # arranged once, so that nothing shifts
            pictures.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert("RGB"))
        first, *others = in_common_colours(pictures)
        first.save(gif, "GIF", save_all=True, append_images=others, duration=round(1000 * period), loop=0)
    except OSError as error:
        raise RecordingError(str(gif), f"it can't be written: {error.strerror}", "Choose another place") from None
    finally:
        plt.close(figure)
    return len(times), period


def _active(recording: Recording) -> tuple[float, float]:
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    active = now[recording.int("state") == State.ACTIVE]
    ends = active if len(active) > 1 else now
    return float(ends[0]), float(ends[-1])


def _whole(middles: Array, reach: Array) -> tuple[Array, Array]:
    """The middle (2,) and half of the size (2,) of what all pictures (n, 2) need."""
    low, high = (middles - reach).min(axis=0), (middles + reach).max(axis=0)
    return (low + high) / 2, (high - low) / 2


def in_common_colours(pictures: list[Image.Image]) -> list[Image.Image]:
    """The pictures in the colours that ten of them need; rare ones aren't merged, since they mean something."""
    some = pictures[:: max(1, len(pictures) // 10)]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (width, height * len(some)))
    for i, picture in enumerate(some):
        sheet.paste(picture, (0, i * height))
    palette = sheet.quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
