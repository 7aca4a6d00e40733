"""The moving picture: a picture for each instant that the time needs, in the colours that mean something."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.body_run import body_file
from helpers.run import refused
from PIL import Image

from srl.runtime.cli import main
from srl.runtime.pictures import film
from srl.runtime.recording.shapes import RAMP


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return body_file(tmp_path_factory.mktemp("r"))


@pytest.mark.slow
def test_it_goes_as_fast_as_the_run_and_moves(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gif = tmp_path / "f.gif"
    assert main(["export", str(file), "--film", str(gif), "--between", "1", "2", "--rate", "5"]) == 0
    assert "6 pictures, 5 a second" in capsys.readouterr().out
    with Image.open(gif) as picture:
        assert (picture.n_frames, picture.info["duration"], picture.info["loop"]) == (6, 200, 0)
        frames = []
        for i in range(6):
            picture.seek(i)
            frames.append(np.asarray(picture.convert("RGB"), int))
    below_title = [frame[60:330] for frame in frames]
    assert all(np.any(a != b) for a, b in pairwise(below_title))


def test_near_and_far_keep_colours_of_their_own(file: Path, tmp_path: Path) -> None:
    """Red is contact; a picture that made it yellow would say something else."""
    gif = tmp_path / "f.gif"
    assert main(["export", str(file), "--film", str(gif), "--between", "1", "1.4", "--rate", "5"]) == 0
    with Image.open(gif) as picture:
        colours = {colour for _, colour in picture.convert("RGB").getcolors(1 << 16)}
    for _, wanted in RAMP:
        assert min(max(abs(a - b) for a, b in zip(c, wanted, strict=False)) for c in colours) < 16, wanted


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("--between", "2", "1"), "isn't before"),
        (("--between", "3", "99"), "Give times from 0 to 3.99 s"),
        (("--rate", "0"), "no rate"),
        (("--show", "nobody"), "nobody"),
    ],
)
def test_what_cannot_be_drawn_is_refused(file: Path, tmp_path: Path, words: tuple[str, ...], output: str) -> None:
    assert output in refused("export", str(file), "--film", str(tmp_path / "f.gif"), *words)
    assert not (tmp_path / "f.gif").exists()


def test_too_many_pictures_are_refused_before_any_is_drawn(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "MOST", 10)
    assert "Give --between BEGIN END" in refused("export", str(file), "--film", str(tmp_path / "f.gif"))


def test_a_folder_that_is_not_there_is_refused(file: Path, tmp_path: Path) -> None:
    gif = tmp_path / "no" / "f.gif"
    assert "can't be written" in refused("export", str(file), "--film", str(gif), "--between", "1", "1.2")
    assert "--film" in refused("export", str(file), "--tree", "t.png", "--between", "1", "2")
