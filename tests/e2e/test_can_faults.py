"""Faults of MIT-mode actuators under a whole run: seven motors on a bus, a real loop and supervisor.

Seven links hang out level and go to and fro; somebody supports them until their motors hold them. One fault each, in
real time over multicast; the motors are the twin's. From its onset to the first frame that damps, and what the wearer
feels of it at the shoulder and at the joint at fault. Run with `-s` to see the rows of the device's page.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import mit_can
from helpers.live_can import Live
from helpers.mit_can import SEVEN
from helpers.run import Running, call
from helpers.wait import until

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.protocol import Register
from srl.runtime.contracts.errors import UNAVAILABLE
from srl.runtime.ipc.header import State
from srl.sim.devices.mit_can.twin import MitCanTwin
from srl.sim.parts.actuators.motors import WINDING_BIT

pytestmark = [pytest.mark.slow, pytest.mark.serial]

AFTER = 1.0  # s from the onset that are looked at
ELBOW = 3  # the fourth joint, which fails
LAW = '''
"""A law that goes to and fro, and gives NaN once a file is there."""

from math import nan, pi, sin
from pathlib import Path

from srl import Controller, ControllerConfig, Signal


NAMES = tuple(f"j{k}" for k in range(1, 8))


class ToAndFro(Controller):
    summary = "to and fro"

    def __init__(self, name, config):
        super().__init__(name, config)
        self.inputs = (Signal(name="position", shape=(7,), unit="rad", labels=NAMES),)
        self.outputs = (Signal(name="q", shape=(7,), unit="rad", labels=NAMES),)
        self._t, self._broken = 0.0, Path("broken")

    def reset(self):
        self._t = 0.0
        self._start = self.input["position"].copy()

    def update(self, dt):
        self._t += dt
        swing = 0.15 * (1 - sin(2 * pi * 0.4 * self._t + pi / 2)) / 2
        self.output["q"][:] = nan if self._broken.exists() else self._start - swing
'''

Twin = MitCanTwin


def nothing(twin: Twin) -> None:
    """The law breaks, not the bus."""


def brown_out(twin: Twin) -> None:
    """It has forgotten where it stands, as a motor without an absolute encoder; and is disabled."""
    i = twin.drives.numbers[ELBOW]
    twin.drives.power_down(ELBOW)
    twin.drives.power_up(ELBOW)
    twin.drives.motors.zero[i] += 1.2


def answers_as_another(twin: Twin) -> None:
    """The elbow gets the wrist's ids, as by the maker's tool."""
    drives = twin.drives
    drives.ids[ELBOW], drives.replies[ELBOW] = drives.ids[ELBOW + 1], drives.replies[ELBOW + 1]


def too_hot(twin: Twin) -> None:
    twin.drives.motors.fail(twin.drives.numbers[ELBOW], WINDING_BIT)


CASES: dict[str, tuple[Callable[[Twin], object], str]] = {  # the fault, and what the run says of it
    "a law gives NaN": (nothing, ""),
    "the bus unplugged, or the motors' side bus-off": (lambda twin: setattr(twin, "muted", True), "doesn't answer"),
    "one of seven silent": (lambda twin: twin.drives.unplugged.add(ELBOW), "doesn't answer"),
    "brown-out of one, its position lost": (brown_out, "was disabled"),
    "one too hot, switches itself off": (too_hot, "too hot"),
    "one has the id of its neighbour": (answers_as_another, ""),
}


@pytest.fixture
def limb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A profile of this bus, with the law as somebody's package."""
    info = tmp_path / "broken_law-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken-law\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[srl.controllers]\nto-and-fro = broken_law:ToAndFro\n")
    (tmp_path / "broken_law.py").write_text(LAW)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def write(twin: Twin, stop: str = "damp") -> Path:
        device = mit_can.config(SEVEN, watchdog=0.3).model_dump(exclude_unset=True, mode="json")
        path = tmp_path / "limb.yaml"
        path.write_text(json.dumps({
            "name": "limb", "rate": 100, "bus": None,
            "devices": {"arm": {"driver": "mit-can"} | device | {"port": twin.address}},
            "controllers": [{
                "use": "to-and-fro", "name": "motion", "in": {"position": "arm.position"},
                "out": {"q": "arm.position_command"},
            }],
            "guard": {"arm.position_command": {"velocity": 0.5, "acceleration": 2.0, "lower": -1.5, "upper": 1.5}},
            "stop": {"arm": stop},
        }))  # fmt: skip
        return path

    return write


def make() -> Twin:
    return mit_can.twin(SEVEN, world=mit_can.cell(SEVEN, length=0.08, mass=0.3), watchdog=0.3)


def damps(live: Live, since: float) -> float | None:
    """When the shoulder first got a frame that damps, s from the onset; None: never."""
    span = live.twin.drives.spans[0]  # type: ignore[attr-defined]
    for at, message in list(live.taken):
        data = bytes(message.data)
        if since < at <= since + AFTER and message.arbitration_id == 1 and data not in protocol.SPECIAL:
            wanted = protocol.parse_command(data, span)
            if not wanted.kp and wanted.kd:
                return at - since
    return None


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CASES)
def test_what_a_fault_does_to_the_wearer(limb: Any, tmp_path: Path, name: str) -> None:
    fault, reported = CASES[name]
    twin = make()
    with Live(twin) as live, Running(tmp_path, str(limb(twin)), instance="limb") as run:
        run.started()

        def moves() -> bool:
            if run.header("state") == State.STOPPED:  # a busy machine: the motors' thread was late
                call(tmp_path, "reset", "limb", code=None)
            rows = live.felt[-2000:]
            return run.header("state") == State.ACTIVE and bool(np.ptp([q for _, q, _ in rows], axis=0).min() > 0.05)

        run.until(moves, "it goes to and fro")
        if fault is nothing:
            (tmp_path / "broken").touch()
        onset = live.do(lambda: fault(twin))
        until(lambda: live.felt[-1][0] > onset + AFTER)
        state = State(run.header("state"))
        run.process.terminate()
        run.finish(code=None)
    felt = [row for row in live.felt if onset - 0.005 < row[0] <= onset + AFTER]
    moved = np.abs(np.ptp([q for _, q, _ in felt], axis=0))
    torque = np.array([t for _, _, t in felt])
    steps = np.abs(np.diff(torque[::4], axis=0)).max(axis=0)
    first = damps(live, onset)
    row = [f"{1e3 * first:.0f}" if first is not None else "none"]
    row += [f"{abs(v[0]):.2f}, {abs(v[ELBOW]):.2f}" for v in (torque[0], moved, np.abs(torque).max(axis=0), steps)]
    print(f"\n| {name} | " + " | ".join(row) + f" | {state.name.lower()}")
    assert "Traceback" not in run.stderr
    assert reported in run.stderr
    assert np.abs(torque).max() < 40.0
    if fault is nothing:
        assert state is State.ACTIVE
        assert first is None
        assert moved[0] < 0.4, "it brakes and stays; the arm swings on its stiffness"
    else:
        assert state is not State.ACTIVE


def test_motors_with_swapped_ids_are_refused_before_anything_moves(limb: Any, tmp_path: Path) -> None:
    twin = make()
    drives = twin.drives
    for register, known in ((Register.ESC_ID, tuple(drives.ids)), (Register.MST_ID, tuple(drives.replies))):
        drives.keep(0, register, known[6])  # a shoulder's motor where a wrist's is wanted
        drives.keep(6, register, known[0])
    with Live(twin) as live:
        done = call(tmp_path, "run", str(limb(twin)), code=None)
        assert done.returncode == UNAVAILABLE
        assert "scales by" in done.stderr
        assert not any(twin.drives.motors.torque)
        assert not any(bytes(message.data) in protocol.SPECIAL for _, message in live.taken)
