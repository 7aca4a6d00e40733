"""pyfirmata2, unchanged, drives the simulated finger and hears its buttons through `srl twin`.

One board in this process only: pyfirmata2 keeps its message handlers in the class. Its constructor waits 5 s.
"""

import time
from pathlib import Path

import numpy as np
import pyfirmata2
import pytest
from helpers.srl_twin import TwinProcess
from helpers.wait import until

from srl.runtime.profile.profile import find

PRESSES = "{go: [[7.5, 7.8], [20, 20.3]], back: [[8.0, 8.3], [20, 20.3]]}"  # s of world time
US_PER_RAD = (2400 - 544) / 3.142


def profile_with_buttons(folder: Path) -> str:
    """The sixth finger's own profile; its board has two buttons, pressed at known times."""
    text = find("sixth-finger")[1]
    text = text.replace(
        "    servos:", "    buttons: {go: {pin: 2}, back: {pin: 3}}\n    servos:", 1
    ).replace(
        "sim:\n",
        f"sim:\n  devices: {{finger: {{presses: {PRESSES}}}}}\n", 1,
    )  # fmt: skip
    path = folder / "buttons.yaml"
    path.write_text(text)
    return str(path)


@pytest.mark.slow
def test_servos_move_and_buttons_are_heard(tmp_path):
    log = tmp_path / "log.npz"
    with TwinProcess(profile_with_buttons(tmp_path), "finger", "--log", str(log)) as twin:
        board = pyfirmata2.Arduino(twin.addresses["finger"])
        assert board.get_firmata_version() == (2, 5)
        assert board.firmware == "StandardFirmata.ino"
        heard: dict[int, list[bool]] = {2: [], 3: []}
        for pin, levels in heard.items():
            button = board.get_pin(f"d:{pin}:u")
            button.register_callback(levels.append)
            button.enable_reporting()
        board.samplingOn()
        servos = {pin: board.get_pin(f"d:{pin}:s") for pin in (9, 10, 11, 6)}
        wanted = {9: 100, 10: 120, 11: 70, 6: 95}  # degrees of the servo
        for pin, angle in wanted.items():
            servos[pin].write(angle)
        time.sleep(1.0)  # the servos turn
        held = time.monotonic_ns()
        servos[9].write(80)
        time.sleep(1.0)
        until(
            lambda: all(len(levels) > 2 and levels[-1] and not all(levels) for levels in heard.values()),
            what=lambda: str(heard),
        )
        board.exit()
    assert twin.process.returncode == 0, twin.output
    metrics = twin.metrics["finger"]
    assert metrics["bytes_lost"] == 0
    assert set(metrics["pulses_us"].values()) == {None}  # exit() detaches
    rows = np.load(log)
    # Before the second write of servo 9: where the world's servos are, against where the angles mean.
    row = np.searchsorted(rows["now_ns"], held) - 1
    pulse = np.array([544 + int(wanted[pin] * 1856 / 180) for pin in (9, 10, 11, 6)])
    angle = -1.571 + (pulse - 544) / US_PER_RAD
    np.testing.assert_allclose(rows["world.finger_position"][row], angle, atol=0.06)  # gravity's sag
    commands = rows["finger.servo_ns"], rows["finger.servo"], rows["finger.pulse_us"]
    last = {
        int(joint): us for at, joint, us in zip(*commands, strict=True) if at < held - 0.3e9
    }  # a late tick stamps early
    np.testing.assert_array_equal([last[joint] for joint in range(4)], pulse)
    later = rows["now_ns"] > held + 0.7e9
    moved = rows["world.finger_position"][later][0][0]
    assert abs(moved - (-1.571 + int(80 * 1856 / 180) / US_PER_RAD)) < 0.06
