"""All joints of a run as one sensor_msgs/msg/JointState."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import joint_names, time_of
from srl.runtime.recording.robots import Robot


@dataclass(frozen=True)
class _Group:
    """One device's joints: its signals, None for what it doesn't measure, and the row's column with its stamp."""

    position: Field
    velocity: Field | None
    effort: Field | None
    column: int


class Joints:
    """Names and values of the joints; `names` (n,), each once.

    A device that measures no position gives what was sent to it last. A joint that follows a device's value by a factor
    (the fingers of a hand with one motor) has the name of its link.
    """

    def __init__(self, layout: Layout, robots: list[Robot]) -> None:
        self._layout = layout
        devices = [device for device in layout.devices if device not in layout.setpoint_owners]
        self._groups = [group for device in devices if (group := self._group(device)) is not None]
        given = [(group.position.name.partition(".")[0], joint_names(group.position)) for group in self._groups]
        self._leaders: dict[tuple[str, str], tuple[str, int]] = {}  # of each element: the link whose joint it is
        self._followers: list[tuple[Robot, int]] = []
        for robot in robots:
            for number in robot.linkage.moving:
                element = robot.angles.partition(".")[0], robot.linkage.links[number].joint
                own = robot.name, number
                if not _plain(robot, number) or self._leaders.setdefault(element, own) != own:
                    self._followers.append((robot, number))
        pairs = [(device, name) for device, names in given for name in names]
        pairs += [(robot.name, robot.linkage.links[number].name) for robot, number in self._followers]
        often = Counter(name for _, name in pairs)
        self.names: list[str] = []
        for owner, name in pairs:
            made, number = name if often[name] == 1 else f"{owner}_{name}", 1
            while made in self.names:
                number += 1
                made = f"{owner}_{name}_{number}"
            self.names.append(made)
        count = len(pairs) - len(self._followers)
        self._of_element = dict(zip(pairs[:count], self.names, strict=False))
        self._of_link = {
            (robot.name, number): name
            for (robot, number), name in zip(self._followers, self.names[count:], strict=True)
        }

    def _group(self, device: str) -> _Group | None:
        fields = self._layout.fields
        position = fields.get(f"{device}.position") or fields.get(f"{device}.position_command.sent")
        if position is None or len(position.shape) != 1 or position.frame is not None or not position.size:
            return None

        def fitting(name: str) -> Field | None:
            found = fields.get(f"{device}.{name}")
            return found if found is not None and found.shape == position.shape else None

        return _Group(position, fitting("velocity"), fitting("effort"), self._layout.stamped_by(position))

    def name_of(self, robot: Robot, number: int) -> str:
        """The name of the joint that moves a robot's link."""
        own = self._of_link.get((robot.name, number))
        return own if own is not None else self.leader_of(robot, number)

    def leader_of(self, robot: Robot, number: int) -> str:
        """The name of the joint that a robot's link follows, its own included; "" where the device's value is none."""
        element = robot.angles.partition(".")[0], robot.linkage.links[number].joint
        return self._of_element.get(element, "") if element in self._leaders else ""

    def message(self, row: NDArray[np.int64], wall: int) -> tuple[int, cdr.Message] | None:
        """The stamp, Unix ns, and the message of a row (width,); None before the first samples.

        The stamp is that of the oldest of the devices' samples. What isn't measured is NaN.
        """
        stamps = [int(row[group.column]) for group in self._groups]
        known = [stamp for stamp in stamps if stamp >= 0]
        if not known:
            return None
        columns: list[list[Array]] = [[], [], []]
        for group in self._groups:
            unknown = row[group.column] < 0  # before its first sample
            for column, field in zip(columns, (group.position, group.velocity, group.effort), strict=True):
                empty = np.full(group.position.size, np.nan)
                column.append(empty if field is None or unknown else self._layout.value(row, field.name))
        values = {group.position.name: column for group, column in zip(self._groups, columns[0], strict=True)}
        for robot, number in self._followers:
            link, found = robot.linkage.links[number], values.get(robot.angles)
            labels = self._layout.fields[robot.angles].labels
            value = np.nan if found is None else found[labels.index(link.joint)]
            columns[0].append(np.array([link.factor * value + link.offset]))
            columns[1].append(np.array([np.nan]))
            columns[2].append(np.array([np.nan]))
        position, velocity, effort = (np.concatenate(column) for column in columns)
        stamp = min(known) + wall
        return stamp, {
            "header": {"stamp": time_of(stamp), "frame_id": ""}, "name": self.names, "position": position,
            "velocity": velocity if np.isfinite(velocity).any() else (),
            "effort": effort if np.isfinite(effort).any() else (),
        }  # fmt: skip


def moved_by_devices(robots: list[Robot], layout: Layout) -> list[Robot]:
    """The robots; one that a recording draws by the simulation's truth is moved by what was sent to its device."""

    def moved(robot: Robot) -> Robot:
        if not robot.angles or layout.fields[robot.angles].role != "truth":
            return robot
        sent = layout.fields.get(f"{robot.name}.position_command.sent")
        fits = sent is not None and set(layout.fields[robot.angles].labels) <= set(sent.labels)
        return replace(robot, angles=sent.name) if sent is not None and fits else robot

    return [moved(robot) for robot in robots]


def _plain(robot: Robot, number: int) -> bool:
    """Whether a link's joint is where the device's value is."""
    link = robot.linkage.links[number]
    return link.factor == 1.0 and link.offset == 0.0
