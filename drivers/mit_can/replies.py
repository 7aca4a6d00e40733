"""Whose reply a frame is, and what it says; or that another program commands a motor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import can

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.protocol import State


@dataclass(frozen=True)
class Reply:
    """What a frame is.

    Attributes:
        motor: its number.
        state: what it says; None: it is another program's command for this motor.
    """

    motor: int
    state: State | None


class Replies:
    """Tells replies apart.

    Attributes:
        spans: the ranges that each motor scales by.
        strange: frames on a motor's reply identifier that are no reply of it.
    """

    def __init__(self, config: MitCanConfig, command_ids: Sequence[int]) -> None:
        motors = list(config.motors.values())
        self._v3, self._damiao = config.generation == "v3", config.maker == "damiao"
        self.spans = [motor.span(config.generation) for motor in motors]
        self.strange = 0
        self._ids = [motor.id for motor in motors]
        self._replies = {config.reply_id(motor): i for i, motor in enumerate(motors)}
        self._commands = {id: i for i, id in enumerate(command_ids)}
        self._status = [protocol.status_scale(motor.facts) for motor in motors]

    def of(self, message: can.Message) -> Reply | None:
        """Returns what concerns a motor; None for a frame that doesn't."""
        data, id = bytes(message.data), message.arbitration_id
        if message.is_extended_id != self._v3 or message.is_remote_frame:
            return None
        i = self._replies.get(id)
        if self._v3:
            if i is not None and len(data) == 8:
                return Reply(i, protocol.v3_status(data, *self._status[i]))
        elif self._damiao:
            if i is not None and len(data) == 8 and data[0] & 0xF == self._ids[i]:
                return Reply(i, protocol.damiao_reply(data, self.spans[i]))
        elif 6 <= len(data) <= 8 and id in (0, data[0]) and (ours := self._commands.get(data[0])) is not None:
            return Reply(ours, protocol.ak_reply(data, self.spans[ours]))
        if (other := self._commands.get(id)) is not None:
            return Reply(other, None)
        self.strange += i is not None
        return None
