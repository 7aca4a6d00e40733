"""Applications to look at: three pictures and a rerun recording of a trial."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib.image
import mujoco
import numpy as np
import rerun as rr

from srl.runtime.contracts.signals import Array
from srl.studies.grasp.applications_rig import STAND, Rig
from srl.studies.grasp.scenes import log_geoms
from srl.studies.tasks.task import Value

Play = Callable[[str, Mapping[str, Any], int, Callable[[Rig], None]], Mapping[str, Value]]

_EVERY: Final = 4  # cycles between two entries of a recording
_SEEN: Final = (1.2, 3.2)  # s: the hand has come, it has closed; the third picture is of the end
_SIZE: Final = (480, 640)  # pixels
_LOOK: Final = (0.0, 0.0, STAND + 0.08)
_FROM: Final = {"bottle": 60.0, "door": 25.0}  # degrees about the vertical, where the hand is upright
_SIDE: Final = 165.0
_ABOVE, _AWAY = -10.0, 0.60  # degrees above the ground, m


def write(folder: Path, name: str, play: Play, text: str, parameters: Mapping[str, Any], seed: int) -> list[str]:
    """Writes `NAME.rrd` and, where pictures can be drawn, `NAME-1.png` to `NAME-3.png`; returns their names.

    Args:
        play: the trial, which calls its last argument after each cycle.
    """
    recording, kept, count = rr.RecordingStream(f"srl-{name}"), [], [0]
    recording.save(str(folder / f"{name}.rrd"))

    def watch(rig: Rig) -> None:
        count[0] += 1
        if count[0] % _EVERY == 0:
            recording.set_time("world", duration=rig.time)
            log_geoms(recording, "scene", rig.cell.model, rig.cell.data)
            kept.append((rig.time, rig.cell.data.qpos.copy()))
            model.setdefault("model", rig.cell.model)

    model: dict[str, Any] = {}
    row = play(text, parameters, seed, watch)
    recording.log("scene/result", rr.TextDocument(str(dict(row))), static=True)
    recording.flush()
    recording.disconnect()
    files = [f"{name}.rrd"]
    if kept:
        times = np.array([time for time, _ in kept])
        chosen = [kept[int(np.argmin(np.abs(times - t)))][1] for t in _SEEN] + [kept[-1][1]]
        files += _pictures(folder, name, model["model"], chosen)
    return files


def _pictures(folder: Path, name: str, model: Any, postures: list[Array]) -> list[str]:
    """Draws them in a process of its own: MuJoCo chooses how to draw when it is imported, and may end a process."""
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = before if before not in (None, "", "disabled") else "egl"
    files = [f"{name}-{number}.png" for number in range(1, len(postures) + 1)]
    compiled = folder / f"{name}.mjb"
    mujoco.mj_saveModel(model, str(compiled), None)
    painter = multiprocessing.get_context("spawn").Process(
        target=_paint,
        args=(compiled, postures, [folder / file for file in files], _FROM.get(name.split("-", maxsplit=1)[0], _SIDE)),
    )
    painter.start()
    painter.join()
    compiled.unlink()
    if before is None:
        del os.environ["MUJOCO_GL"]
    drawn = [file for file in files if (folder / file).exists()]
    if len(drawn) < len(files):
        print(f"no pictures of {name}: this machine can't draw without a screen (MUJOCO_GL)", file=sys.stderr)
    return drawn


def _paint(compiled: Path, postures: list[Array], files: list[Path], azimuth: float) -> None:
    model = mujoco.MjModel.from_binary_path(str(compiled))
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = azimuth, _ABOVE, _AWAY
    camera.lookat[:] = _LOOK
    shown = mujoco.MjvOption()
    shown.sitegroup[:] = 0
    with mujoco.Renderer(model, *_SIZE) as renderer:
        for posture, file in zip(postures, files, strict=True):
            data.qpos[:] = posture
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera, shown)
            matplotlib.image.imsave(file, renderer.render())
