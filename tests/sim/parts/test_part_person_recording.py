"""The simulated person: recorded forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.person import MS, cell, run
from helpers.shared import shared
from pydantic import ValidationError

from srl.runtime.contracts.errors import RecordingError, WiringError
from srl.sim.parts.person.person import PersonConfig, PersonPart
from srl.sim.parts.things.ft_sensor import FtSensorPart, HandlePart

# -- recordings


def replayed(recording: Any, **options: Any) -> Any:
    """A person who replays forces at a sensor's handle."""
    held = {"at": {"parent": "handle/grip", "position": [0, 0, 0.06]}}
    parts: Any = {
        "sensor": (FtSensorPart, {"at": {"position": [0, 0, 0.035]}}),
        "handle": (HandlePart, {"at": "sensor/tool"}),
        "person": (PersonPart, held | {"recording": recording} | options),
    }
    return cell(parts, gravity=(0.0, 0.0, 0.0))


def test_recorded_forces_reach_the_sensor(tmp_path):
    t = np.linspace(0.0, 2.0, 201)
    F = np.zeros((201, 6))
    F[:, 0], F[:, 2] = 5 * np.sin(2 * t), -3.0
    np.savez(tmp_path / "f.npz", t=t, F=F)
    world = replayed({"file": tmp_path / "f.npz", "start": 0.5, "scale": 2.0})
    seen = run(world, 3.0)
    wanted = np.interp(seen["time"] - 0.002, t + 0.5, 10 * np.sin(2 * t), left=0, right=0)
    np.testing.assert_allclose(seen["sensor_wrench"][:, 0], wanted, atol=0.1)
    assert world.parts["person"].duration == 2.5
    assert seen["sensor_wrench"][100, 2] == pytest.approx(-6.0, abs=1e-6)
    assert seen["sensor_wrench"][-1] == pytest.approx(np.zeros(6), abs=1e-9)


def test_a_guided_pandas_forces_are_read_as_scipy_reads_them():
    io = pytest.importorskip("scipy.io")
    path = shared("data/panda_comanipulation/symbol_17.mat")
    row = io.loadmat(path, squeeze_me=True, struct_as_record=False)["symbol_data"][3]
    world = replayed({"file": path, "number": 3, "frame": "hand"})
    assert world.parts["person"].duration == pytest.approx((row.F.shape[1] - 1) * 1.42e-3, rel=0.03)
    world.advance(2000 * MS)
    step = world.parts["person"].duration / (row.F.shape[1] - 1)
    near = row.F[:, round(1.998 / step)]
    np.testing.assert_allclose(world.truth_arrays["person_wrench"][:3], near, atol=0.15)


def test_a_handovers_wrench_is_replayed_at_120_hz():
    path = shared("data/handover_mocap_wrench/Wrench_interaction_saved.csv")
    world = replayed({"file": path})
    assert world.parts["person"].duration == pytest.approx(800 / 120)
    world.advance(2 * MS)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(world.truth_arrays["person_wrench"], table[0], atol=1e-6)
    seen = run(world, 6.0)
    np.testing.assert_allclose(seen["person_wrench"].std(axis=0), table.std(axis=0), rtol=0.15)


def test_wrong_recordings_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        replayed({"file": tmp_path / "none.csv"})
    (tmp_path / "a.csv").write_text("p,q\n1,2\n")
    with pytest.raises(RecordingError, match="Fx, Fy, Fz"):
        replayed({"file": tmp_path / "a.csv"})
    (tmp_path / "b.mat").write_bytes(b"MATLAB 7.3" + bytes(200))
    with pytest.raises(RecordingError, match="version 5"):
        replayed({"file": tmp_path / "b.mat"})
    np.savez(tmp_path / "c.npz", t=np.arange(3.0), F=np.zeros((3, 5)))
    with pytest.raises(RecordingError, match=r"\(n, 6\)"):
        replayed({"file": tmp_path / "c.npz"})
    with pytest.raises(ValidationError, match="not both"):
        PersonConfig.model_validate(
            {"at": "a/b", "recording": {"file": "x.csv"}, "plan": [{"do": "hold", "seconds": 1}]}
        )


def test_a_recording_is_refused_without_a_handle(tmp_path):
    np.savez(tmp_path / "f.npz", t=np.arange(3.0), F=np.zeros((3, 6)))
    for at in (None, {"position": [0, 0, 1]}):
        with pytest.raises(WiringError, match=r"sim\.parts\.person\.at: a 'recording' is replayed at a handle"):
            replayed({"file": tmp_path / "f.npz"}, at=at)
    replayed({"file": tmp_path / "f.npz"})


def test_a_damaged_mat_file_is_an_error_and_no_crash(tmp_path):
    good = shared("data/panda_comanipulation/symbol_17.mat").read_bytes()[:20000]
    rng = np.random.default_rng(0)
    for k in range(60):
        data = bytearray(good)
        for at in rng.integers(128, len(data), 5):
            data[at] = int(rng.integers(256))
        path = tmp_path / "f.mat"
        path.write_bytes(data[: int(rng.integers(100, len(data)))])
        with pytest.raises(RecordingError):
            replayed({"file": path, "number": k % 2})
