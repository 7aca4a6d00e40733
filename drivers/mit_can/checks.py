"""What must be so before MIT-mode actuators are opened, and when they are opened again."""

from __future__ import annotations

from srl.drivers.canbus import CanLink
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.opening import Found
from srl.runtime.contracts.errors import DeviceError


def stoppable(link: CanLink, config: MitCanConfig, place: str) -> None:
    """Whether another program can stop the motors if this one dies. Raises DeviceError: it can't, nor do they."""
    if config.maker != "damiao" and link.stop_fileno() is None and link.interface != "virtual":
        raise DeviceError(
            place,
            f"no other program can stop these motors over {link.interface} if this one dies, and a CubeMars isn't "
            "known to stop by itself",
            "Use an adapter of SocketCAN or slcan",
        )


def same_place(found: Found, before: list[float], config: MitCanConfig, place: str) -> None:
    """Refuses a joint whose turn was told by its park, if this isn't where it was when it was last heard.

    A joint that stands whole turns away from its park, with its power on, seems parked (sheet, section 2.7).

    Args:
        found: of this opening.
        before: rad of the shaft, by motor: where each was when it was last heard.
        config, place: the device's.
    Raises:
        DeviceError: one stands elsewhere.
    """
    for (name, motor), state, offset, was in zip(
        config.motors.items(), found.states, found.offset, before, strict=True
    ):
        now = state.position + offset
        if motor.park is not None and abs(now - was) > config.start_tolerance:
            angles = [(shaft - motor.zero) * motor.scale for shaft in (was, now)]
            raise DeviceError(
                place,
                f"'{name}' (id {motor.id}) stood at {angles[0]:.2f} when it was last heard, and would be at "
                f"{angles[1]:.2f} if it was parked",
                "Nobody can tell its turns now: support the limb, park it, switch its drives off and on there, and "
                "start the run anew",
            )
