"""Plots: what references mean, their errors, and the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers_recording import make_layout, make_rows
from matplotlib import image
from pydantic import ValidationError

from runtime.errors import RecordingError
from runtime.recorder.figure import draw
from runtime.recorder.plots import Plot, series_names
from runtime.recorder.reader import Recording


def test_lines_pick_elements_and_distances_are_euclidean() -> None:
    layout = make_layout()
    rows = make_rows(layout, 50)
    tips, tip, q = (layout.value(rows, name) for name in ("hand.tips", "world.tip", "world.finger"))
    plot = Plot(
        title="p",
        unit="m",
        lines={"a": "hand.tips[1,2]", "q": "world.finger"},
        distance={"d": ("hand.tips[0]", "world.tip")},
    )
    curves = plot.curves(layout, rows)
    assert list(curves) == ["a", "q abduction", "q mcp", "q pip", "q dip", "d"]
    assert np.array_equal(curves["a"], tips[:, 1, 2])
    assert np.array_equal(curves["q pip"], q[:, 2])
    assert np.allclose(curves["d"], np.sqrt(((tips[:, 0] - tip) ** 2).sum(axis=1)), rtol=1e-14)


def test_series_are_named_by_labels_and_axes() -> None:
    layout = make_layout()
    assert series_names(layout, "hand.tips")[3:6] == ["index x", "index y", "index z"]
    assert series_names(layout, "mapping.sphere") == ["x", "y", "z", "radius"]
    assert series_names(layout, "world.finger") == ["abduction", "mcp", "pip", "dip"]


@pytest.mark.parametrize(
    ("lines", "distance", "reason"),
    [
        ({"a": "world.fingr"}, {}, "Did you mean 'world.finger'"),
        ({"a": "world.finger[4]"}, {}, "shaped \\(4,\\)"),
        ({}, {"d": ("hand.tips", "world.tip")}, "not \\(3,\\)"),
    ],
)
def test_wrong_references_say_what_is_wrong(
    lines: dict[str, str], distance: dict[str, tuple[str, str]], reason: str
) -> None:
    layout = make_layout()
    with pytest.raises(RecordingError, match=reason):
        Plot(title="p", unit="m", lines=lines, distance=distance).curves(layout, make_rows(layout, 3))


def test_a_plot_of_nothing_is_refused() -> None:
    with pytest.raises(ValidationError, match="needs 'lines' or 'distance'"):
        Plot(title="p", unit="m")


@pytest.mark.parametrize("plots", [True, False])
def test_the_picture_has_a_panel_for_each_part(tmp_path: Path, plots: bool) -> None:
    layout = make_layout()
    if not plots:
        del layout.meta["record"]
    rows = make_rows(layout, 3000)
    recording = Recording(Path("x.rrd"), layout, np.arange(1, 3001), rows, [(10, 12)], [], 0)
    draw(recording, tmp_path / "x.png")
    picture = image.imread(tmp_path / "x.png")
    assert picture.shape[0] > (900 if plots else 500)
    assert picture[..., :3].std() > 0.05  # not blank
    with pytest.raises(RecordingError, match="can't be written"):
        draw(recording, tmp_path / "absent" / "x.png")
