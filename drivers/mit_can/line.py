"""The open bus as MIT-mode actuators use it: frames by motor, what waits for a reply, a bus that takes nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import can

from srl.drivers.canbus import CanLink
from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.contracts.errors import DeviceLostError

OWED: Final = 256  # replies that are waited for at most: an adapter may hold back many and give them at once
EXTRA: Final = 10  # replies that nobody asked for, within
LATELY: Final = 500_000_000  # ns, after which another motor answers, too
REFUSED: Final = 100_000_000  # ns in which the bus takes no frame, after which it is given up


def command_ids(config: MitCanConfig) -> list[int]:
    """The identifiers that the motors listen to."""
    return [(protocol.V3_COMMAND if config.generation == "v3" else 0) + id for id in config.ids]


class Line:
    """One open bus.

    Attributes:
        link: the bus.
        pending: by motor, frames sent since its last reply.
        left: by motor, ns of the newest frame that left.
        refused: frames for which the bus had no room.
    """

    def __init__(self, link: CanLink, config: MitCanConfig, place: str) -> None:
        self.link, self._place = link, place
        self._ids, self._listen, self._v3 = config.ids, command_ids(config), config.generation == "v3"
        self.pending = [0] * len(self._ids)
        self.left = [-1] * len(self._ids)
        self.refused = 0
        self._since = -1  # ns, since when the bus takes nothing
        self._owed = [0] * len(self._ids)
        self._extra = [(0, 0)] * len(self._ids)  # how many came unasked, and since when, ns

    def send(self, i: int, data: bytes, now: int | None = None) -> bool:
        """Sends a motor's frame; False if the bus has no room, which is never tried again.

        Raises:
            DeviceLostError: the bus is gone, or by `now` it has taken nothing for some time.
        """
        self.pending[i] += 1
        if self._write(i, self._message(i, data)):
            self._since = -1
            self.left[i] = now if now is not None else self.left[i]
            return True
        self.refused += 1
        if now is not None:
            if self._since < 0:
                self._since = now
            elif now - self._since > REFUSED:
                raise DeviceLostError(
                    self._place,
                    "the bus takes no frame: nobody acknowledges it",
                    "Check the motors' power (an e-stop?) and the wires. Then take the interface down and up, which "
                    "discards the frames that wait in it",
                )
        return False

    def ask(self, i: int) -> None:
        """Asks a Damiao for its state, without a command."""
        data = protocol.ask_state(self._ids[i])
        self._write(i, can.Message(arbitration_id=protocol.REGISTERS, data=data, is_extended_id=False))
        self.pending[i] += 1

    def tell(self, i: int, data: bytes) -> None:
        """Sends a special frame, whose reply isn't counted on; an AK V3 has none."""
        if not self._v3:
            self._write(i, self._message(i, data))

    def doubled(self, i: int, now: int) -> bool:
        """Takes a reply; whether too many came that no frame asked for. A V3 sends its status by itself."""
        self.pending[i] = 0
        if self._v3 or self._owed[i]:
            self._owed[i] -= not self._v3
            return False
        count, since = self._extra[i]
        self._extra[i] = (count + 1, since) if now - since < LATELY else (1, now)
        return self._extra[i][0] >= EXTRA

    def _write(self, i: int, message: can.Message) -> bool:
        left = self.link.write(message)
        self._owed[i] = min(self._owed[i] + left, OWED)
        return left

    def stop_frames(self, frames: Sequence[bytes], off: bool) -> tuple[bytes, ...]:
        """These commands as another process writes them, one a motor; with `off` each is then disabled."""
        found = []
        for i, data in enumerate(frames):
            found.append(self.link.stop_frame(self._message(i, data)))
            if off and not self._v3:
                found.append(self.link.stop_frame(self._message(i, protocol.DISABLE)))
        return tuple(frame for frame in found if frame)

    def _message(self, i: int, data: bytes) -> can.Message:
        return can.Message(arbitration_id=self._listen[i], data=data, is_extended_id=self._v3)
