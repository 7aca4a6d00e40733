"""A mobile base: sends velocity commands, receives wheel odometry, over zenoh.

zenoh runs in its own process (`srl.drivers.zenoh_link`). Each command expires there: if the loop stops sending, zero
velocity follows at once and for one second. After that the robot's own time-out (0.5 s) holds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from srl.drivers.base import protocol, ros
from srl.drivers.base.config import BaseConfig
from srl.drivers.zenoh_link import Link, Outlet, wire
from srl.drivers.zenoh_link.stamps import SourceTime
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal, Stop
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST

COMMAND = "twist_command"
UNIT = "m/s, rad/s"
SILENT = 1_000_000_000  # ns without odometry after which the link is opened again
FIRST = 5.0  # s that the first odometry may take
FARTHEST = 0.1  # s for which the pose is extrapolated at most
# Periods of the command: a loop that isn't a multiple of its rate sends some commands a cycle later, and the zenoh
# process, of ordinary priority, may take the one before late (43 ms apart were seen on a busy host at 50 Hz).
LATE = 2.5
PRESSED = "its emergency stop is pressed, or the robot holds itself stopped; release it at the robot"
_ODOMETRY, _EMERGENCY = 0, 1


class MobileBase(Driver):
    """A mobile base that follows a velocity command.

    States `pose` (3,): x (m), y (m), yaw (rad, unwrapped) of the base in its odometry frame, extrapolated by the
    twist between messages; `twist` (3,): vx, vy (m/s), wz (rad/s) in the base's frame. Command
    `twist_command` (3,): as `twist`, kind velocity. Source: protocol sheet summit-xl-zenoh.
    """

    Config = BaseConfig
    summary = "mobile base with ROS 2 behind zenoh (SUMMIT-XL STEEL): velocity out, odometry in"
    gives = ("pose", "twist")
    takes = (COMMAND,)
    pictured_as = "summit-xl"
    max_age = 0.25

    def __init__(self, name: str, config: BaseConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self.states = (
            Signal(name="pose", shape=(3,), unit="m, rad", frame=config.frame, of=name, labels=PLANAR),
            Signal(name="twist", shape=(3,), unit=UNIT, frame=name, of=name, labels=PLANAR_TWIST),
        )
        self.commands = (
            Command(
                name=COMMAND, shape=(3,), unit=UNIT, labels=PLANAR_TWIST,
                kind=Kind.VELOCITY, feedback="pose", stops=(Stop.BRAKE, Stop.HOLD), period=LATE / config.rate,
                ordered=True,
            ),
        )  # fmt: skip
        speed = np.array(config.speed)
        if not config.sideways:
            speed[1] = 0.0
        self.limits[COMMAND] = Limits(velocity=speed, acceleration=np.array(config.acceleration))
        self._kind = protocol.TWIST if config.message == "Twist" else protocol.TWIST_STAMPED
        self._top = speed.tolist()
        self._zero = protocol.velocity(self._kind, 0.0, 0.0, 0.0)
        self._link = Link(name)
        self._reader = protocol.OdometryReader()
        self._time = SourceTime()
        self._period = round(1e9 / config.rate)
        self._expiry = round(config.expiry * 1e9)
        self._was_lost = False
        self._pose, self._twist = np.zeros(3), np.zeros(3)
        self._repeated = 0  # ns, when the newest came whose stamp isn't newer
        self._offset = 0  # the robot's clock minus ours, ns
        self._arrived = 0
        self._written = 0
        self._expires = 0  # ns, CLOCK_MONOTONIC: the end of the newest command
        self._published = 0
        self._frame = ""
        self._heard_emergency = False

    def open(self) -> None:
        """Blocks up to about 10 s. The base doesn't move.

        Raises:
            DeviceError: no connection, no odometry, another frame, or the robot expects another message type.
        """
        self.close()
        config, link = self._config, self._link
        subscribe = [self._key(config.odometry)]
        if config.emergency is not None:
            subscribe.append(self._key(config.emergency))
        topic = config.topic(config.command)
        key = topic
        if config.middleware == "rmw_zenoh":
            key = self._find_key(topic)  # only an open session can query it
        stamp_at = protocol.STAMP_AT if self._kind == protocol.TWIST_STAMPED else None
        outlet = Outlet(key, "", self._zero, stamp_at, config.middleware == "rmw_zenoh")
        self._time.restart()
        self._arrived, self._frame = 0, ""
        self._heard_emergency = False
        try:
            link.open(config, subscribe, [outlet], [])
            note = ""
            if config.middleware == "bridge":
                note = self._check_type(link.tokens(ros.bridge_tokens(topic)), topic, ros.read_bridge_token)
            self._await_odometry()
        except BaseException:
            link.close()
            raise
        self._written = 0
        self.health.connected = True
        self.health.reconnects += self._was_lost
        self._was_lost = False
        self.health.message = f"odometry in '{self._frame}'{note}"

    def read(self, now: int) -> None:
        """The newest odometry is used; late odometry keeps its own, old stamp."""
        try:
            events = self._link.read()
        except DeviceLostError:
            self._lose()
            raise
        for event in events:
            if isinstance(event, wire.Sample):
                self._take(event)
        health, reader = self.health, self._reader
        health.frames, health.errors = reader.frames, reader.errors
        health.unsent = len(self._zero) if self._link.untaken else 0
        if time.monotonic_ns() - self._arrived > SILENT:
            self._lose()
            if self._repeated > self._arrived:
                raise DeviceLostError(
                    self.name,
                    "its odometry comes, but its stamp stands still or went back",
                    "Check the robot's clock, and that the publisher of its odometry sets header.stamp",
                )
            raise DeviceLostError(
                self.name,
                f"no odometry came for {SILENT / 1e9:g} s" + (f" ({reader.problem})" if reader.errors else ""),
                "Check the robot, its bridge and the network",
            )
        if time.monotonic_ns() > self._expires:
            self._publish_zero()
        states = self.state_arrays
        states["twist"][:] = self._twist
        age = min(max((now - health.stamp) * 1e-9, 0.0), FARTHEST) if self._config.extrapolate else 0.0
        states["pose"][:] = protocol.carried(self._pose, self._twist, age)

    def write(self, now: int) -> None:
        """Sends at most `rate` commands per second; each expires after `expiry`."""
        clock = time.monotonic_ns()
        if clock - self._written < self._period:
            return
        vx, vy, wz = self.command_arrays[COMMAND].tolist()
        if not math.isfinite(vx + vy + wz):
            return  # the last command expires
        top = self._top
        vx, vy, wz = (min(max(v, -t), t) for v, t in zip((vx, vy, wz), top, strict=True))
        payload = protocol.velocity(self._kind, vx, vy, wz)
        try:
            expires = clock + self._expiry
            if self._link.publish(0, payload, expires, clock + self._offset):
                self.sent_arrays[COMMAND][:] = vx, vy, wz
                self._expires = expires
                # The phase is kept, so that a loop of 100 Hz sends 50 commands per second and not 33.
                late = clock - self._written - self._period
                self._written = clock - late if 0 <= late < self._period else clock
                self._published += 1
        except DeviceLostError:
            self._lose()
            raise

    def stop(self, category: Stop) -> None:
        """Sends zero velocity; the robot brakes along its own ramp."""
        self._link.stop()
        self._publish_zero()

    def recover(self, now: int) -> None:
        """An e-stop is released at the robot, which then reports it.

        If an e-stop was pressed before the link was lost and no report has come since, it counts as released.
        Otherwise robots that report only changes would keep the base stopped for ever.
        """
        if not self._heard_emergency:
            self.health.fault = ""

    def close(self) -> None:
        """Sends zero velocity if it was commanded, then ends the connection."""
        self.health.connected = False
        self._link.close()

    def fileno(self) -> int | None:
        """The socket to the zenoh process."""
        return self._link.fileno()

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """Requests zero velocity from the zenoh process."""
        return self._link.stop_frames

    def metrics(self) -> dict[str, object]:
        """Returns commands handed over, the odometry's frame, and the newest sample's delay over the fastest's (ns)."""
        return {"commands": self._published, "frame": self._frame, "delay_ns": self._time.delay}

    def _key(self, topic: str) -> str:
        full = self._config.topic(topic)
        return full if self._config.middleware == "bridge" else ros.rmw_key(self._config.domain, full)

    def _find_key(self, topic: str) -> str:
        """Returns the command's key for rmw_zenoh: it contains a hash that only the robot's own subscriber reports."""
        self._link.open(self._config, [], [], [])
        tokens = self._link.tokens(ros.rmw_tokens(self._config.domain, topic))
        self._link.close()
        self._check_type(tokens, topic, ros.read_rmw_token)
        found = [s for t in tokens if (s := ros.read_rmw_token(t)) is not None]
        if not found:
            raise DeviceError(
                self.name,
                f"no node subscribes to '{topic}' in ROS domain {self._config.domain}",
                "Start the robot's controller, or correct `command`, `namespace` and `domain`",
            )
        return found[0].key

    def _check_type(self, tokens: list[str], topic: str, read: Callable[[str], ros.Subscriber | None]) -> str:
        """Refuses a robot that expects another message type. Returns a note for the user."""
        kinds = {s.type for t in tokens if (s := read(t)) is not None}
        if kinds and self._kind not in kinds:
            other = sorted(kinds)[0]
            raise DeviceError(
                self.name,
                f"the robot takes {other} on '{topic}', the profile sends {self._kind}",
                f"Set `message: {other.rpartition('/')[2]}`, or correct `command`",
            )
        return "" if kinds else f"; the bridge names no subscriber of '{topic}'"

    def _await_odometry(self) -> None:
        deadline = time.monotonic() + FIRST
        while not self._arrived:
            rest = deadline - time.monotonic()
            if rest <= 0:
                problem = f" that is valid ({self._reader.problem})" if self._reader.problem else ""
                topic = self._config.topic(self._config.odometry)
                raise DeviceError(
                    self.name,
                    f"no odometry{problem} came on '{topic}' in {FIRST:g} s",
                    "Start the robot's controller, or correct `odometry` and `namespace`",
                )
            for event in self._link.wait(rest):
                if isinstance(event, wire.Sample):
                    self._take(event)
                    if not self._arrived and event.source == _ODOMETRY and self._frame:
                        self._refuse_frame()

    def _refuse_frame(self) -> None:
        wanted = self._config.child_frame or "one that ends in base_link or base_footprint"
        raise DeviceError(
            self.name,
            f"the odometry is of '{self._frame}', expected {wanted}",
            "Correct `odometry`, or name the frame in `child_frame`",
        )

    def _take(self, sample: wire.Sample) -> None:
        if sample.source == _EMERGENCY:
            pressed = protocol.read_bool(sample.payload)
            if pressed is None:
                self._reader.errors += 1
            else:
                self.health.fault = PRESSED if pressed else ""
                self._heard_emergency = True
            return
        for message in self._reader.feed(sample.payload):
            self._frame = message.child_frame
            if not protocol.frame_fits(message.child_frame, self._config.child_frame):
                self._reader.errors += 1
                self._reader.problem = f"it is of '{message.child_frame}'"
                continue
            stamp = self._time.stamp(message.stamp, sample.arrived)
            if stamp is None:
                self._repeated = sample.arrived
                continue  # a repetition, or the robot's clock was set back: not new in either case
            self._arrived = sample.arrived
            self._offset = message.stamp - stamp
            self.health.stamp = stamp
            x, y, yaw = message.pose
            turns = round((self._pose[2] - yaw) / math.tau)
            self._pose[:] = x, y, yaw + turns * math.tau
            self._twist[:] = message.twist

    def _publish_zero(self) -> None:
        """Reports that no command is in force any more: the zenoh process sends zero then."""
        if self._expires:
            self.sent_arrays[COMMAND][:] = 0.0
            self._expires = 0

    def _lose(self) -> None:
        self.health.connected = False
        self._was_lost = True
