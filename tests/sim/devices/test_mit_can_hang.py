"""What the supervisor's stop frames do to an arm of CubeMars after the loop's death and after a hang, simulated.

An arm of two links hangs out level. Run with `-s` to see the rows of docs/devices/mit-can.md.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mit_can import AK, PERIOD, Limb

from srl.runtime.contracts.signals import Array, Stop


def hung(silence: float, seconds: float, category: Stop, written: bool | None = None) -> tuple[Array, Array]:
    """The loop says nothing for so long; then the stop frames are written twice, 20 ms apart, as the supervisor does.

    Returns how far each joint has moved (rad) in the second after the hang, and the largest change of its torque
    (N m) within 4 ms. `written`: whether frames are written; None: as the driver allows.
    """
    limb = Limb(AK, "v2", fake={"silence": silence}).open()
    limb.hold()
    driver = limb.fake.driver
    if written is None:
        written = seconds <= driver.frames_good_for(category)
    frames = [motor.held if category is Stop.HOLD else motor.damp for motor in driver._motors]
    started, torques = limb.truth(), list[Array]()

    def rest(s: float) -> None:
        for _ in range(round(s * 1e9 / PERIOD)):
            limb.world.advance(limb.world.time + PERIOD)
            torques.append(limb.truth("effort"))

    rest(seconds)
    del torques[:-1]
    for _ in range(2):
        for i, frame in enumerate(frames if written else ()):
            limb.drives.take(limb.drives.ids[i], frame, False)
        rest(0.02)
    rest(1.0)
    moved: Array = np.abs(limb.truth() - started)
    steps: Array = np.abs(np.diff(np.array(torques)[::2], axis=0)).max(axis=0)
    return moved, steps


CASES = {
    "killed, lets go after 25 ms, `hold`": (0.025, 0.012, Stop.HOLD, None),
    "hung 0.12 s, lets go after 25 ms, `hold` frames all the same": (0.025, 0.12, Stop.HOLD, True),
    "hung 0.12 s, lets go after 25 ms, `hold`: no frames": (0.025, 0.12, Stop.HOLD, None),
    "hung 0.12 s, lets go after 25 ms, `damp`": (0.025, 0.12, Stop.DAMP, None),
    "hung 0.12 s, never lets go, `hold`: no frames": (0.0, 0.12, Stop.HOLD, None),
    "hung 0.12 s, never lets go, `damp`": (0.0, 0.12, Stop.DAMP, None),
}


@pytest.mark.slow
def test_after_a_hang_no_frame_pulls_a_limb_back_that_has_let_go() -> None:
    found = {name: hung(*case) for name, case in CASES.items()}
    for name, (moved, step) in found.items():
        print(f"\n| {name} | {moved[0]:.2f}, {moved[1]:.2f} | {step[0]:.2f}, {step[1]:.2f} |", end="")
    allowed = found["hung 0.12 s, lets go after 25 ms, `hold`: no frames"]
    forced = found["hung 0.12 s, lets go after 25 ms, `hold` frames all the same"]
    assert forced[1][0] > 5 * max(allowed[1][0], 0.1), "the pull that is spared"
    assert found["hung 0.12 s, never lets go, `hold`: no frames"][0].max() < 0.02
    assert found["hung 0.12 s, never lets go, `damp`"][0].max() > 0.5, "to damp a limb that still holds lets it sink"
