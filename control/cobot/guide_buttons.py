"""The four buttons of the guiding handle (Giammarino et al. 2022, III-A): converts presses to modes."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Signal

BUTTONS: Final = ("A", "M", "G", "P")
MODES: Final = ("admittance", "rotation", "gripper_closed", "locomotion")
ADMITTANCE, ROTATION, GRIPPER, LOCOMOTION = range(4)  # their places


class GuideButtonsConfig(ControllerConfig):
    """Options of `guide-buttons`."""

    gripper: Literal["open", "closed"] = Field("open", description="as it is when the program starts")


class GuideButtons(Controller):
    """Converts presses of the handle's buttons to modes.

    Input `buttons` (4,): A, M, G, P, each 1 while pressed, debounced by the device. Output `modes` (4,):
    admittance on, rotation too, gripper closed, locomotion; each 0 or 1.

    Each press toggles its mode. A reset gives admittance off, translation only, manipulation. The gripper stays as
    it is, since it may hold something. A button held during the reset counts only after it has been released.
    """

    Config = GuideButtonsConfig
    summary = "handle's buttons to modes: admittance, rotation, gripper, locomotion (SUPER-MAN)"

    def __init__(self, name: str, config: GuideButtonsConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="buttons", shape=(4,), unit="1", labels=BUTTONS),)
        self.outputs = (Signal(name="modes", shape=(4,), unit="1", labels=MODES),)
        self._modes = [0.0, 0.0, float(config.gripper == "closed"), 0.0]
        self._held = [True] * 4
        self._presses = [0] * 4

    def reset(self) -> None:
        self._modes = [0.0, 0.0, self._modes[GRIPPER], 0.0]
        self._held = self._pressed()
        self.output["modes"][:] = self._modes

    def update(self, dt: float) -> None:
        pressed = self._pressed()
        if pressed != self._held:
            for i in range(4):
                if pressed[i] and not self._held[i]:
                    self._modes[i] = 1.0 - self._modes[i]
                    self._presses[i] += 1
            self._held = pressed
        self.output["modes"][:] = self._modes

    def metrics(self) -> dict[str, object]:
        """Returns the number of presses of each button."""
        return {"presses": dict(zip(BUTTONS, self._presses, strict=True))}

    def _pressed(self) -> list[bool]:
        return [value > 0.5 for value in self.input["buttons"].tolist()]
