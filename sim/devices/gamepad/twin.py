"""The twin of a gamepad: the events of an F310 in X mode, as Linux's xpad driver sends them."""

from __future__ import annotations

from typing import Final

from srl.drivers.evdev import AxisInfo, Description
from srl.drivers.gamepad.driver import BUTTONS, D_MODE, HAT, STICKS, TRIGGERS, VENDOR, X_MODE
from srl.sim.devices.gamepad.fake import FakeGamepad
from srl.sim.devices.shared.evdev import EventTwin

_STICK: Final = (-32768, 32767, 16, 128)  # minimum, maximum, fuzz, flat


class GamepadTwin(EventTwin):
    """Sends the pad's events. Attribute `d_mode`: the switch on its back is at D."""

    def __init__(self, fake: FakeGamepad) -> None:
        super().__init__(fake)
        self.pad = fake
        self.d_mode = False

    def describe(self) -> Description:
        """In D mode only its numbers are simulated."""
        sticks, dpad, pressed = self.pad.axes(), self.pad.dpad(), self.pad.buttons()
        axes = {}
        for i, code in enumerate(STICKS):
            # The y axes are the bitwise complement of what USB sends, so a centred stick reads -1.
            count = round(sticks[i] * 32767)
            axes[code] = AxisInfo(~count if i % 2 else count, *_STICK)
        for i, code in enumerate(TRIGGERS):
            axes[code] = AxisInfo(round(sticks[4 + i] * 255), 0, 255)
        axes[HAT[0]], axes[HAT[1]] = AxisInfo(int(dpad[0]), -1, 1), AxisInfo(-int(dpad[1]), -1, 1)
        down = frozenset(code for code, on in zip(BUTTONS.values(), pressed, strict=True) if on)
        return Description(
            "Logitech Dual Action" if self.d_mode else "Logitech Gamepad F310",
            "", VENDOR, D_MODE if self.d_mode else X_MODE, 0x4014, frozenset(BUTTONS.values()), down, axes,
        )  # fmt: skip
