"""A Franka arm as a device: speaks FCI directly, in the loop, with one command for each robot state."""

from __future__ import annotations

import contextlib
import socket
import time
from typing import Final
from urllib.parse import urlsplit

import numpy as np

from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Addressed
from srl.drivers.panda.channel import Channel, open_channel
from srl.drivers.panda.config import COMMANDS, FORCE, STATES, PandaConfig, commands, states
from srl.drivers.panda.limits import BY_VERSION
from srl.drivers.panda.motion import Motion, Phase
from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Reply, Status
from srl.drivers.panda.requests import AutomaticErrorRecovery, Body, StopMove
from srl.drivers.panda.state import Modes, StateReader
from srl.drivers.timeout import remaining
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

FIRST_STATE: Final = 1.0  # s from Connect to the first state
MASS: Final = 0.01  # kg by which two masses may differ, as the robot tells them rounded
SETTINGS: Final = 5.0  # s for the robot to accept the options
GONE: Final = 1_000_000_000  # ns without a state after which the robot counts as lost (libfranka uses the same time)
_MOST_LOST: Final = 10_000  # states; a longer gap means that the count jumped
UNWRITTEN: Final = 3  # states without `write` after which a motion is ended properly; after 20 the robot aborts it
WIND_UP: Final = 1.0  # s for ending a motion when the device is closed
_TICK: Final = 1_000_000  # ns per message id
_RUNNING, _IDLE = Phase.RUNNING, RobotMode.IDLE  # looking a member up takes longer than comparing it
_WORDS: Final = {
    RobotMode.USER_STOPPED: "stopped by a person: release the stop button (or the enabling device) at the arm",
    RobotMode.GUIDING: "guided by a person: let the guiding buttons at the arm go",
    RobotMode.AUTOMATIC_ERROR_RECOVERY: "recovering from errors",
    RobotMode.OTHER: "not ready: open the brakes and activate FCI in the robot's web interface",
}


class Panda(Addressed):
    """Panda (FER) or FR3; one of `torque_command` (N m), `velocity_command` (rad/s), `position_command` (rad), (7,).

    The robot adds its own gravity compensation to the torques. States (7,): `position`, `velocity`, `effort`
    (measured), `desired_effort` (N m, the torque that the robot took last), `external_effort` (estimated); `wrench`
    (6,) at the stiffness frame and `pose` of the end effector, both in the base frame; `success_rate` (1,), share of
    the last 100 commands that came in time.

    With `interface: none` it is only read: no motion begins, nothing is set and no error is cleared.

    A motion begins with the first `write`. It ends with `stop`, with `close` or when no more writes come. The robot
    stops by itself 20 ms after the last command, so no stop frame is needed; a velocity is then reported as zero.
    `health.errors` counts states that were malformed or never came. Source: protocol sheet franka-fci.
    """

    Config = PandaConfig
    summary = "Franka Emika Panda or Franka Research 3: torque, velocity or position of the joints (FCI, 1 kHz)"
    gives = STATES
    takes = COMMANDS
    links = ("flange",)
    pictured_as = "panda"
    max_age = 0.05

    def __init__(self, name: str, config: PandaConfig) -> None:
        super().__init__(name, config)
        self.config: PandaConfig = config
        self.states = states(config, name)
        self.ranges["wrench"] = -FORCE, FORCE
        self.commands = commands(config)
        self._command = self.commands[0].name if self.commands else ""
        self._channel: Channel | None = None
        self._states: Datagrams | None = None
        self._version = 5  # to try first; later the version that the robot spoke
        self._reader = StateReader(5)
        self._motion = Motion(5, config.kind, self._reader)
        self._time = DeviceTime(_TICK)
        self._settings: list[Body] = []  # settings that the robot hasn't accepted yet
        self._missed = self._moves = 0
        self._gone = False
        self._forget()

    def _forget(self) -> None:
        """Resets everything known about the robot, because it is opened (again)."""
        self._newest = b""  # the newest state
        self._id = self._answered = -1  # message ids: of the newest state, and of the last answered state
        self._tail = b""
        self._modes = Modes(0, 0, RobotMode.OTHER, (), ())
        self._heard: int | None = None  # when the last state arrived
        self._unwritten = 0
        self._trouble = ""  # what the robot refused, until the user has seen it
        self._recovering = False
        self._judged: tuple[bytes, str, str, bool] | None = None  # the inputs from which `health.fault` was made

    # -- lifecycle

    def open(self) -> None:
        """Blocks up to 20 s. Options are sent if the robot is idle, otherwise as soon as it is.

        A robot in reflex or stopped by a person is opened all the same, with `health.fault` set.
        """
        self.close()
        self._forget()
        link = open_datagrams("udp://:0", place=self._place, listen=True)
        channel = None
        try:
            channel = open_channel(self.config.port, place=self._place, port=link.local[1], version=self._version)
            self._version = version = channel.version
            self._reader = StateReader(version)
            self._moves += self._motion.started
            self._motion = Motion(version, self.config.kind, self._reader)
            self._time.restart()
            self._await_states(link)
            self._channel, self._states = channel, link
            self._settle(link)
            end_effector = self._check_masses()
        except BaseException:
            self._channel = self._states = None
            link.close()
            if channel is not None:
                channel.close()
            raise
        self.limits.update({c.name: BY_VERSION[version].of(c.kind) for c in self.commands})
        self.health.opened()
        self.health.message = f"{BY_VERSION[version].name}, FCI protocol {version}, end effector {end_effector:g} kg"
        self._gone = False

    def _await_states(self, link: Datagrams) -> None:
        """Waits for the first state and connects the link to its sender."""
        host = urlsplit(self.config.port[self.config.port.index("tcp://") :]).hostname or ""
        address = socket.gethostbyname(host)
        for left in remaining(FIRST_STATE):
            found = [data for data in link.read_wait(left) if len(data) >= self._reader.size]
            if found and link.peer is not None and link.peer[0] == address:
                link.connect(link.peer)
                self._take_states(found, time.monotonic_ns())
                return
        raise self._error(
            f"the robot accepted the connection, but none of its states arrived within {FIRST_STATE:g} s",
            "Let a firewall on this host pass UDP from the robot",
        )

    def _settle(self, link: Datagrams) -> None:
        """Sends the options and waits until they are accepted, if the robot is idle."""
        self._settings = list(self.config.settings())
        deadline = time.monotonic() + SETTINGS
        channel = self._channel
        assert channel is not None
        while self._modes.mode is RobotMode.IDLE and not self._modes.errors:
            self._send_settings(channel)
            if channel.idle:
                break
            if time.monotonic() > deadline:
                raise self._error("the robot doesn't reply to its settings", "Check its state in its web interface")
            self._take_states(link.read_wait(0.01), time.monotonic_ns())
            channel.poll(time.monotonic_ns())
        if self._trouble:
            raise self._error(self._trouble, "Correct the option in the profile")
        self._judge()

    def _check_masses(self) -> float:
        """Returns the end effector's mass, kg. A load that an earlier program left pushes the arm up as soon as it is
        commanded a torque, and is felt as a force.
        """
        end_effector, load = (float(f"{mass:.4g}") for mass in self._reader.masses(self._newest))
        wanted = self.config.end_effector
        if wanted is not None and not abs(end_effector - wanted) <= MASS:
            raise self._error(
                f"the end effector set in Desk is {end_effector:g} kg, the profile says {wanted:g}",
                "Set in Desk what is mounted, or correct 'end_effector'",
            )
        if self.config.load is None and self.config.interface != "none" and not abs(load) <= MASS:
            raise self._error(
                f"an earlier program set a load of {load:g} kg, which the robot compensates; the profile names none",
                "Give 'load' with what the flange carries, `load: {mass: 0}` for nothing",
            )
        return end_effector

    def close(self) -> None:
        """Blocks up to 1.5 s if a motion has to be ended first."""
        channel, link = self._channel, self._states
        if channel is not None and link is not None and not self._gone:
            with contextlib.suppress(DeviceError):
                self._wind_up(channel, link)
        self._channel = self._states = None
        self._motion.abandon()
        self.health.connected = False
        self.health.fault = ""
        if channel is not None:
            channel.close()
        if link is not None:
            link.close()

    def _wind_up(self, channel: Channel, link: Datagrams) -> None:
        """Ends the motion as the protocol requires; if that fails, stops it."""
        motion = self._motion
        motion.end()
        self._heard = None
        deadline = time.monotonic() + WIND_UP
        while motion.phase is Phase.ENDING and time.monotonic() < deadline:
            self._take_states(link.read_wait(0.01), time.monotonic_ns())
            self._answer()
            channel.poll(time.monotonic_ns())
        if motion.phase is Phase.NONE:
            return
        replies: list[Reply] = []
        channel.ask(StopMove(), replies.append)
        deadline = time.monotonic() + WIND_UP / 2
        while not replies and time.monotonic() < deadline:
            channel.poll(time.monotonic_ns())
            time.sleep(0.001)

    # -- cycle

    def read(self, now: int) -> None:
        """Takes the newest of the states that have arrived; older ones are only counted."""
        channel, link = self._session()
        try:
            self._take_states(link.read(), now)
            channel.poll(now)
        except DeviceLostError:
            self._lose()
            raise
        if self._heard is None:
            self._heard = now
        elif now - self._heard > GONE:
            self._lose()
            raise DeviceLostError(
                self._place, "no state came from the robot for 1 s", "Check its power, its cable and that FCI is active"
            )
        elif self._motion.starve(now - self._heard):
            self.sent_arrays[self._command][:] = self._motion.values
        if self._newest and self._modes.mode is _IDLE and not self._modes.errors:
            self._send_settings(channel)
        self._judge()
        if self._id != self._answered:
            self._unwritten += 1
            if self._unwritten > UNWRITTEN:
                self._motion.end()
            if self._motion.phase is Phase.ENDING:
                self._answer()

    def write(self, now: int) -> None:
        """Sends one command for the newest state, or requests a motion if there is none."""
        channel, _ = self._session()
        if not self.commands:
            return
        self._unwritten = 0
        motion = self._motion
        if motion.phase is _RUNNING:
            self._answer()
        elif motion.phase is Phase.NONE and self._may_move(channel):
            channel.ask(motion.ask(), motion.reply)

    def stop(self, category: Stop) -> None:
        """Later `read`s bring the arm to rest, then its own controller takes over."""
        self._motion.end()

    def recover(self, now: int) -> None:
        """Runs automatic error recovery if the robot has errors, and clears other messages."""
        channel, _ = self._session()
        if not self.commands:
            return
        self._trouble = self._motion.outcome = ""
        if (self._modes.mode is RobotMode.REFLEX or self._modes.errors) and not self._recovering:
            self._recovering = True
            channel.ask(AutomaticErrorRecovery(), self._on_recovery)
        self._judge()

    def fileno(self) -> int | None:
        """Returns the socket of the robot's states: readable at each robot cycle. Commands are sent through it, too."""
        return self._states.fileno() if self._states is not None else None

    def metrics(self) -> dict[str, object]:
        """Returns protocol, motions begun, and states that never came (by gaps in the message id)."""
        moves = self._moves + self._motion.started
        return {"robot": BY_VERSION[self._version].name, "moves": moves, "lost_states": self._missed}

    # -- parts of a cycle

    def _take_states(self, found: list[bytes], now: int) -> None:
        """Counts the states, oldest first, and takes the newest."""
        health, reader = self.health, self._reader
        newest = b""
        for data in found:
            if len(data) < reader.size:
                health.errors += 1
                continue
            number = reader.message_id(data)
            gap = number - self._id - 1 if self._id >= 0 else 0
            if gap < 0:
                health.errors += 1  # a newer state overtook it on the network
                continue
            gap = min(gap, _MOST_LOST)
            self._missed += gap
            health.errors += gap
            health.frames += 1
            newest, self._id = data, number
        if not newest:
            return
        self._heard = now
        if self.state_arrays and not reader.fill(newest, self.state_arrays):
            health.errors += 1
            self._answered = self._id  # this state gets no answer
            return
        self._newest = newest
        health.stamp = self._time.stamp(self._id, now)
        tail = reader.tail(newest)
        if tail != self._tail:
            self._tail, self._modes = tail, reader.modes(tail)
        self._motion.watch(self._modes, newest)

    def _answer(self) -> None:
        """Sends the command for the newest state, once per state."""
        link = self._states
        if self._id == self._answered or link is None or not self._motion.shown(self._modes):
            return
        arrays = self.command_arrays
        wanted = arrays[self._command] if arrays else np.zeros(7)
        packet = self._motion.packet(self._newest, wanted)
        try:
            sent = link.write(packet)
        except DeviceLostError:
            self._lose()
            raise
        self.health.unsent = 0 if sent else len(packet)
        if sent and arrays:
            self.sent_arrays[self._command][:] = self._motion.values
        self._answered = self._id

    def _may_move(self, channel: Channel) -> bool:
        idle = self._modes.mode is RobotMode.IDLE and not self._modes.errors
        return idle and channel.idle and not self._settings and not self.health.fault

    def _send_settings(self, channel: Channel) -> None:
        if self._settings and channel.idle and not self._trouble:
            channel.ask(self._settings[0], self._on_setting)

    def _on_setting(self, reply: Reply) -> None:
        if reply.status is Status.SUCCESS:
            self._settings.pop(0)
        else:  # the setting stays in the list, so that nothing moves before the robot has accepted it
            self._trouble = f"the robot refuses {reply.command.__name__}: {reply.status}"

    def _on_recovery(self, reply: Reply) -> None:
        self._recovering = False
        if reply.status is not Status.SUCCESS:
            self._trouble = f"automatic error recovery: {reply.status}"

    def _judge(self) -> None:
        """Sets `health.fault` to what keeps the robot from moving, if anything does."""
        motion, modes = self._motion, self._modes
        if self._judged == (self._tail, self._trouble, motion.outcome, self._recovering):
            return
        words = _WORDS.get(modes.mode, "")
        if modes.mode is RobotMode.REFLEX:
            words = f"reflex: {', '.join(modes.reasons or modes.errors) or 'no reason given'}"
        elif modes.errors and not words:
            words = f"error: {', '.join(modes.errors)}"
        elif self._recovering and not words:
            words = _WORDS[RobotMode.AUTOMATIC_ERROR_RECOVERY]  # it shows no errors any more, but hasn't replied yet
        if words:
            motion.outcome = ""  # the robot's own reason for ending the motion is better
        found = ", ".join(filter(None, (words, self._trouble, motion.outcome)))
        if self.commands:
            self.health.fault = found
        else:  # what keeps it from moving keeps nobody from reading it
            self.health.message = found or f"{BY_VERSION[self._version].name}, only read"
        self._judged = self._tail, self._trouble, motion.outcome, self._recovering

    def _session(self) -> tuple[Channel, Datagrams]:
        if self._channel is None or self._states is None:
            raise self._not_open()
        return self._channel, self._states

    def _lose(self) -> None:
        self.health.connected = False
        self._gone = True
