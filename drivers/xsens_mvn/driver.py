"""An Xsens suit as a device: the newest pose of one of MVN's characters."""

from __future__ import annotations

import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians
from typing import Final

import numpy as np

from srl.drivers.capture.axes import z_up_point
from srl.drivers.capture.names import Point
from srl.drivers.capture.order import Order
from srl.drivers.capture.upright import Upright
from srl.drivers.capture.view import View
from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.devicetime import DeviceTime
from srl.drivers.pause import Pause
from srl.drivers.xsens_mvn import protocol
from srl.drivers.xsens_mvn.assembly import Assembly, Sample
from srl.drivers.xsens_mvn.config import MvnConfig, signals
from srl.drivers.xsens_mvn.protocol import CENTRE, JOINT_ENDS, JOINTS, POSES, SEGMENTS, MalformedError, Pose
from srl.drivers.xsens_mvn.sources import Sources
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.rotation import Quaternion, normalised
from srl.runtime.contracts.signals import Array

FIRST: Final = 2.0  # s for the first sample of everything wanted
OTHERS: Final = 0.1  # s in which another one that sends the same character would be heard, too
SILENT: Final = 2_000_000_000  # ns without a datagram of the character after which the port is opened anew
_TICK: Final = 1_000_000  # ns of MVN's time code
_FAR: Final = 10.0  # m; a pelvis that is higher is in cm
_NAMES: Final = {POSES: "Position + Orientation (Quaternion)", JOINTS: "Joint Angles", CENTRE: "Center of Mass"}
_HEAD: Final = SEGMENTS.index("Head") + 1
_REMEDY: Final = "In MVN's Network Streamer add this computer's address and port as a target; check the firewall"


@dataclass(slots=True)
class _Shown:
    segments: list[tuple[int, Point, Quaternion]] = field(default_factory=list)
    markers: list[tuple[int, Point]] = field(default_factory=list)
    unlabelled: list[Point] = field(default_factory=list)


class XsensMvn(Sensor):
    """Poses of segments, joint angles and the centre of mass of one person, z up.

    States: `pose` (k, 7): x, y, z (m), qw, qx, qy, qz of segments in MVN's world; a segment's axes are the world's in
    the T-pose, x forward. `<name>.pose` (7,), the same of one; `visible` (k,). `joint_angles` (n, 3), rad, about the
    joint's x, y, z as MVN means it. `centre_of_mass` (3,), m. What a sample lacks is NaN after `max_age`.

    A sample's stamp comes from MVN's time code, whose offset the smallest delay fixes; `delay` is subtracted. Nothing
    counts until the person was seen upright once: `up` may be wrong. (Sheet xsens_mvn.)
    """

    Config = MvnConfig
    summary = "Xsens suit (MVN network streamer): segments, joint angles, centre of mass"
    gives = ("pose", "<name>.pose", "visible", "joint_angles", "centre_of_mass")
    max_age = 0.1

    def __init__(self, name: str, config: MvnConfig) -> None:
        super().__init__(name, config)
        self.states = signals(config)
        self._config = config
        self._place = f"{name} ({config.port})"
        self._view = View(config)
        self._rows = {SEGMENTS.index(of) + 1: row for row, of in enumerate(config.segments.values())}
        self._joints = [JOINT_ENDS[joint] for joint in config.joints]
        self._wanted = {POSES} | ({JOINTS} if config.joints else set()) | ({CENTRE} if config.centre_of_mass else set())
        self._link: Datagrams | None = None
        self._sender: str | None = None
        self._sources = Sources()
        self._foreign = self._others = self._missed = self._other_types = 0
        self._begin()

    def _begin(self) -> None:
        self._assembly = Assembly()
        self._orders = {kind: Order(32) for kind in self._wanted}
        self._upright = Upright()
        self._characters: set[int] = set()
        self._sources.begin()
        self._newest: dict[int, int] = {}  # ns, the stamp of each type's newest sample
        self._heard = -1
        self._restarted()

    def _restarted(self) -> None:
        """The stream began anew: its clock did, too."""
        self._time, self._pause = DeviceTime(_TICK), Pause()
        self._number: int | None = None

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self._view.bind(states)
        self._expire(0)

    # -- lifecycle

    def open(self) -> None:
        """Blocks up to 2 s."""
        self.close()
        self._begin()
        self._sender = self._address(self._config.sender)
        link = self._link = open_datagrams(self._config.port, place=self._place, listen=True)
        try:
            self._find(link)
        except DeviceError:
            self.close()
            raise
        self.health.stamp = -1
        self.health.opened()

    def read(self, now: int) -> None:
        if self._link is None:
            raise DeviceLostError(self._place, "it isn't open", "Open it first")
        try:
            samples = self._samples(self._link.read_from(), now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        if self._heard < 0 or any(sample.kind == POSES for sample in samples):
            self._heard = now
        newest: dict[int, Sample] = {}
        for sample in samples:
            order = self._orders[sample.kind]
            restarts = order.restarts
            if not order.is_new(sample.number):
                continue
            if sample.kind == POSES:
                if order.restarts != restarts:
                    self.health.resyncs += 1
                    self._restarted()
                    self._upright.restart()
                elif self._number is not None:
                    self._missed += max((sample.number - self._number) % (1 << 32) - 1, 0)
                self._number = sample.number
            newest[sample.kind] = sample
        for kind in (POSES, JOINTS, CENTRE):
            if kind in newest:
                self._take(newest[kind], now)
        self._expire(now)
        if now - self._heard > SILENT:
            self.health.lost("nothing of this person for 2 s")
            raise DeviceLostError(self._place, "nothing of this person for 2 s", "Is MVN streaming, is the suit on?")

    def close(self) -> None:
        link, self._link = self._link, None
        self.health.connected = False
        if link is not None:
            link.close()

    def metrics(self) -> dict[str, object]:
        """Samples that never came whole, that came late; datagrams of other persons, computers, types; restarts."""
        return {
            "missed_samples": self._missed,
            "incomplete": self._assembly.incomplete,
            "late_samples": sum(order.late for order in self._orders.values()),
            "restarts": self._orders[POSES].restarts,
            "others": self._others,
            "foreign": self._foreign + self._sources.left_out,
            "other_types": self._other_types,
        }

    # -- cycle

    def _samples(self, datagrams: list[tuple[bytes, tuple[str, int]]], now: int) -> list[Sample]:
        """The complete samples of this person, of the types that are wanted."""
        found = []
        for data, address in datagrams:
            if self._sender is not None and address[0] != self._sender:
                self._foreign += 1
                continue
            try:
                datagram = protocol.split(data)
            except MalformedError:
                self.health.errors += 1
                continue
            if datagram.character != self._config.character:
                self._others += 1
                self._characters.add(datagram.character)
                continue
            if datagram.kind not in self._wanted:
                self._other_types += 1
                continue
            if not self._sources.takes(datagram.kind, address, now):
                continue
            if (sample := self._assembly.take(datagram)) is not None:
                found.append(sample)
        return found

    def _take(self, sample: Sample, now: int) -> None:
        try:
            if sample.kind == POSES:
                self._take_poses(protocol.poses(sample.items, sample.payload), sample, now)
            elif sample.kind == JOINTS and self._upright.proven:
                self._take_joints(protocol.joints(sample.items, sample.payload), now)
            elif sample.kind == CENTRE and self._upright.proven:
                self.state_arrays["centre_of_mass"][:] = self._point(protocol.centre(sample.payload))
                self._newest[CENTRE] = now
        except MalformedError as error:
            self.health.errors += 1
            self.health.message = str(error)

    def _take_poses(self, poses: list[Pose], sample: Sample, now: int) -> None:
        stamp = self._time.stamp(sample.time, now)
        if self._pause.over(self._time.delay, now):
            self._time.restart()
            stamp = self._time.stamp(sample.time, now)
        stamp -= round(self._config.delay * 1e9)
        self.health.frames += 1
        places = {pose.segment: self._placed(pose) for pose in poses}
        if not self._usable(places):
            return
        shown = _Shown([(row, *places[number]) for number, row in self._rows.items() if number in places])
        self._view.show(shown, stamp, round(self.max_age * 1e9))
        self._newest[POSES] = now
        if lacking := [SEGMENTS[number - 1] for number in self._rows if number not in places]:
            self.health.message = f"no pose of {', '.join(lacking)}"
        if self._view.seen:
            self.health.stamp = stamp

    def _placed(self, pose: Pose) -> tuple[Point, Quaternion]:
        w, x, y, z = normalised(pose.rotation)
        x, y, z = self._point((x, y, z))  # the axes are renamed alike
        return self._point(pose.position), (w, x, y, z)

    def _point(self, p: Point) -> Point:
        """In axes x forward, y to the left, z up."""
        if self._config.up == "z":
            return p
        x, y, z = p
        return (z, x, y) if self._config.forward == "z" else z_up_point(p)

    def _usable(self, places: Mapping[int, tuple[Point, Quaternion]]) -> bool:
        """Whether these can be m, and z up."""
        self.health.message = self._sources.warning
        if 1 in places and max(map(abs, places[1][0])) > _FAR:
            self.health.message = "the pelvis is more than 10 m away: is MVN sending centimetres?"
            return False
        if self._upright.proven:
            return True
        if 1 not in places or _HEAD not in places:
            self.health.message = "pelvis and head aren't in the stream: nothing tells which axis is up"
            return False
        usable = self._upright.judge(places[1][0], places[_HEAD][0], f"up: {self._config.up}")
        self.health.message = self._upright.why or self._sources.warning
        return usable

    def _take_joints(self, found: Mapping[tuple[int, int], tuple[float, float, float]], now: int) -> None:
        angles = self.state_arrays["joint_angles"]
        for row, ends in enumerate(self._joints):
            x, y, z = found.get(ends, (np.nan, np.nan, np.nan))
            angles[row] = radians(x), radians(y), radians(z)
        self._newest[JOINTS] = now

    def _expire(self, now: int) -> None:
        """Angles or a centre of mass of long ago are none."""
        for kind, name in ((JOINTS, "joint_angles"), (CENTRE, "centre_of_mass")):
            if kind in self._wanted and now - self._newest.get(kind, -(10**18)) > self.max_age * 1e9:
                self.state_arrays[name].fill(np.nan)

    # -- opening

    def _address(self, host: str | None) -> str | None:
        if host is None:
            return None
        try:
            return socket.gethostbyname(host)
        except (OSError, UnicodeError):
            raise DeviceError(self._place, f"no host is called '{host}'", "Correct 'sender'") from None

    def _find(self, link: Datagrams) -> None:
        """Waits until everything wanted has come once."""
        heard, kinds = b"", set[int]()
        deadline = time.monotonic() + FIRST
        before = self._others, self._foreign, self._other_types
        while (left := deadline - time.monotonic()) > 0 and not kinds >= self._wanted:
            link.wait(left)
            datagrams = link.read_from()
            heard = heard or (datagrams[0][0] if datagrams else b"")
            kinds |= {sample.kind for sample in self._samples(datagrams, time.monotonic_ns())}
        if kinds >= self._wanted:
            self._alone(link)
            return
        if self._sources.warning and self._sender is None:
            raise self._two()
        if kinds:
            lacking = ", ".join(_NAMES[kind] for kind in sorted(self._wanted - kinds))
            raise DeviceError(self._place, f"MVN doesn't send: {lacking}", "Tick it in MVN's Network Streamer")
        others, foreign, types = (
            a - b for a, b in zip((self._others, self._foreign, self._other_types), before, strict=True)
        )
        if types:
            raise DeviceError(self._place, f"MVN sends, but not: {_NAMES[POSES]}", "Tick it in MVN's Network Streamer")
        if others:
            ids = ", ".join(map(str, sorted(self._characters)))
            problem = f"nothing of character {self._config.character} came; MVN sends character {ids}"
            raise DeviceError(self._place, problem, "Correct 'character'")
        if foreign:
            raise DeviceError(
                self._place, f"{foreign} datagrams came, none from {self._config.sender}", "Correct 'sender'"
            )
        shown = f"{len(heard)} bytes that aren't: {heard[:12].hex(' ')}" if heard else "nothing"
        raise DeviceError(self._place, f"expected MVN's stream, got {shown}", _REMEDY)

    def _alone(self, link: Datagrams) -> None:
        """Nobody can tell which of two that send this character is the wearer's."""
        deadline = time.monotonic() + OTHERS
        while (left := deadline - time.monotonic()) > 0:
            link.wait(left)
            self._samples(link.read_from(), time.monotonic_ns())
        if self._sources.warning:
            raise self._two()

    def _two(self) -> DeviceError:
        return DeviceError(
            self._place,
            f"{self._sources.warning}. Nobody can tell which is the wearer's",
            "End the other stream in its MVN, or set 'sender' to the wearer's computer; after MVN has moved to another "
            "computer, start the run anew",
        )
