"""One motion, from the request to its end, and the packets within it. No I/O.

The robot replies to Move twice: when the motion has started, and how it ended. In between one command answers each
state. The last commands carry the flag that ends the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from math import isfinite
from struct import Struct
from typing import Final

import numpy as np

from srl.drivers.panda.limiter import MotionLimiter, TorqueLimiter
from srl.drivers.panda.limits import BY_VERSION
from srl.drivers.panda.packets import ROOM, Controller, Generator, command_dtype
from srl.drivers.panda.protocol import Reply, Status
from srl.drivers.panda.requests import Move
from srl.drivers.panda.state import Modes, StateReader
from srl.runtime.contracts.compiled import bind_or_python, numbers, undone
from srl.runtime.contracts.signals import Array, Kind

TIMEOUT: Final = 1000  # states to wait for a reply after the motion's end, or for the motion after its start
STARVED: Final = 25_000_000  # ns without a state to answer: the robot ends a motion after 20 lost packets (sheet)
STILL: Final = 0.02  # share of the velocity limit: slower than this a joint is at rest
_SEVEN: Final = Struct("<7d")


class Phase(Enum):
    """The phase of a motion."""

    NONE = "none"
    ASKED = "asked"  # Move was sent, or the robot's states don't show the motion yet
    RUNNING = "running"
    ENDING = "ending"  # the arm is brought to rest, then the end is flagged, then the last reply is awaited


# Looking a member up takes longer than comparing it.
_NONE, _ASKED, _RUNNING, _ENDING = Phase
_POSITION, _TORQUE = Kind.POSITION, Kind.TORQUE


class Motion:
    """One motion; see the module's docstring.

    Attributes:
        phase: the present phase.
        started: number of motions that began.
        outcome: why the last motion ended or couldn't begin, if we didn't end it; "" otherwise.
        values: (7,), the command in the newest packet, within the robot's limits, rad, rad/s or N m; to be copied.
    """

    def __init__(self, version: int, kind: Kind, reader: StateReader) -> None:
        self.phase = Phase.NONE
        self.started = 0
        self.outcome = ""
        self.values: Sequence[float] | Array = [0.0] * 7
        self._kind, self._reader = kind, reader
        self._limits = BY_VERSION[version]
        self._torque, self._motion = TorqueLimiter(self._limits), MotionLimiter(self._limits)
        generator, finished, setpoint = {
            Kind.POSITION: (Generator.JOINT_POSITION, "motion_generation_finished", "q_c"),
            Kind.VELOCITY: (Generator.JOINT_VELOCITY, "motion_generation_finished", "dq_c"),
            # Protocol 5 has no torque without a generator, so joint velocities of zero are used.
            Kind.TORQUE: (Generator.JOINT_VELOCITY, "motion_generation_finished", "tau_J_d")
            if version == 5
            else (Generator.NONE, "torque_command_finished", "tau_J_d"),
        }[kind]
        controller = Controller.EXTERNAL if kind is Kind.TORQUE else Controller.JOINT_IMPEDANCE
        self._modes = (generator, controller)
        self.request = Move(controller, generator - 1)
        layout = command_dtype(version)
        assert layout.fields is not None
        self._setpoint_at, self._finished_at = int(layout.fields[setpoint][1]), int(layout.fields[finished][1])
        self._wanted, command = np.zeros(7), np.zeros(ROOM[1])
        self._packet = command.data.cast("B")[: layout.itemsize]
        places = numbers(reader.at("tau_J_d"), self._setpoint_at)
        self._torques_in_c = undone
        if kind is Kind.TORQUE:
            self._torques_in_c = bind_or_python(
                "panda-torque", reader.body, places, self._wanted, self._torque.limits, self._torque.sent, command
            )
        self._damping = [E / V for E, V in zip(self._limits.effort, self._limits.velocity, strict=True)]
        self._still = [STILL * V for V in self._limits.velocity]
        self._started = False  # the robot has reported that the motion started
        self._flagged = False
        self._answered = 0  # message id
        self._hidden = 0  # consecutive states that don't show the motion

    def ask(self) -> Move:
        """Returns the request that begins a motion; its replies go to `reply`."""
        self.phase, self.outcome = Phase.ASKED, ""
        self._started = self._flagged = False
        self._hidden = 0
        return self.request

    def reply(self, reply: Reply) -> None:
        """Takes a reply to Move."""
        if reply.status is Status.MOTION_STARTED:
            self._started = True
            return
        wanted = reply.status is Status.SUCCESS and self._flagged
        if not wanted and self.phase is not Phase.NONE:
            self.outcome = f"motion {reply.status}" if self._started else f"no motion: {reply.status}"
        self.phase = Phase.NONE

    def watch(self, modes: Modes, data: bytes) -> None:
        """Takes a state: the motion runs from the first state that shows it."""
        if self.phase is _NONE or not self._started:
            return
        if not self.shown(modes):
            self._hidden += 1
            if self._hidden > TIMEOUT:
                self.phase, self.outcome = Phase.NONE, "motion ended without a word of the robot"
            return
        self._hidden = 0
        if self.phase is _ASKED:
            self.phase = Phase.RUNNING
            self.started += 1
            self._torque.start()
            self._motion.start(self._reader.joints(data, "q_d"))
            self._answered = self._reader.message_id(data) - 1

    def shown(self, modes: Modes) -> bool:
        """Returns whether the state's modes are those of this motion."""
        return (modes.generator, modes.controller) == self._modes

    def end(self) -> None:
        """From now on the packets bring the arm to rest and end the motion."""
        if self.phase is Phase.RUNNING:
            self.phase = Phase.ENDING

    def starve(self, silence: int) -> bool:
        """Whether the robot has just ended a velocity by itself, unheard. Then `values` are zero.

        `silence`: ns for which no state came, and so no command left. The next motion begins at rest, whatever was
        commanded before the silence.
        """
        moving = self._kind is Kind.VELOCITY and self.phase in (Phase.RUNNING, Phase.ENDING) and any(self.values)
        if not moving or silence <= STARVED:
            return False
        self.values = [0.0] * 7
        return True

    def abandon(self) -> None:
        """Marks the motion as over: the session has ended, or the motion has been given up."""
        self.phase = Phase.NONE

    def packet(self, data: bytes, wanted: Array) -> bytes:
        """Returns the command that answers a state, within the robot's limits.

        Args:
            data: the state.
            wanted: (7,) rad, rad/s or N m; not used while the motion is being ended.
        """
        packet = self._packet
        if not self._pack_in_c(data, wanted):
            asked = wanted.tolist()
            self.values = values = self._torques(data, asked) if self._kind is _TORQUE else self._movement(data, asked)
            packet[0:8] = data[0:8]  # the message id
            _SEVEN.pack_into(packet, self._setpoint_at, *values)
        packet[self._finished_at] = self._flagged
        return bytes(packet)

    def _pack_in_c(self, data: bytes, wanted: Array) -> bool:
        """Torques of a running motion; returns whether it has put them and the message id into the packet."""
        if self._kind is not _TORQUE or self.phase is not _RUNNING:
            return False
        self._wanted[:] = wanted
        self._reader.hold(data)
        self.values = self._torque.sent
        return self._torques_in_c(0.0, self._reader.single) >= 0

    def _torques(self, data: bytes, wanted: list[float]) -> list[float]:
        taken = self._reader.joints(data, "tau_J_d")
        if self.phase is _ENDING:
            dq = self._reader.joints(data, "dq")
            # The robot's own controller takes over where the arm rests, whatever load it holds. Torques can stay on.
            self._flagged = self._flagged or all(abs(v) <= s for v, s in zip(dq, self._still, strict=True))
            wanted = list(taken) if self._flagged else [-d * v for d, v in zip(self._damping, dq, strict=True)]
        return self._torque.step(wanted, taken)

    def _movement(self, data: bytes, wanted: list[float]) -> list[float]:
        reader, motion = self._reader, self._motion
        if not self._flagged:
            q_d, dq_d, ddq_d = (reader.joints(data, name) for name in ("q_d", "dq_d", "ddq_d"))
            if isfinite(sum(q_d) + sum(dq_d) + sum(ddq_d)):
                number = reader.message_id(data)
                motion.take(q_d, dq_d, ddq_d, number - self._answered)
                self._answered = number
        if self.phase is _ENDING:
            self._flagged = self._flagged or motion.at_rest
            if not self._flagged:
                motion.velocity([0.0] * 7)
        elif self._kind is _POSITION:
            motion.position(wanted)
        else:
            motion.velocity(wanted)
        if self._kind is _POSITION:
            return motion.q
        return [0.0] * 7 if self._flagged else motion.dq
