"""FCI's command channel (TCP 1337): requests and replies, both directions. No I/O.

A message is a header of 12 bytes (u32 command, u32 the client's counter, u32 size with header) and a body. A reply's
body begins with a status byte. Protocols 5 (Panda, FER) and 10 (FR3) number commands and statuses differently.
The bodies of requests are in `requests`, the datagrams in `packets`. Source: protocol sheet franka-fci, sections 2, 3
and 5.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

from srl.drivers.panda.packets import VERSIONS
from srl.drivers.panda.requests import (
    AutomaticErrorRecovery,
    Body,
    Connect,
    GetCartesianLimit,
    GetRobotModel,
    LoadModelLibrary,
    Move,
    SetCartesianImpedance,
    SetCollisionBehavior,
    SetEEToK,
    SetFilters,
    SetGuidingMode,
    SetJointImpedance,
    SetLoad,
    SetNEToEE,
    StopMove,
)

PORT = 1337
HEADER = struct.Struct("<III")
CONNECT_REPLY = struct.Struct("<H")  # the robot's version, after the status


class Status(StrEnum):
    """The result of a request."""

    SUCCESS = "success"
    INCOMPATIBLE_VERSION = "incompatible version"
    ERROR = "error"
    NOT_POSSIBLE = "command not possible in the present mode"
    INVALID_ARGUMENT = "invalid argument"
    SAFETY_REJECTED = "rejected: a safety function is active"
    MOTION_STARTED = "motion started"
    PREEMPTED = "preempted"
    SAFETY_PREEMPTED = "preempted: a safety function became active"
    SINGULAR_POSE = "start at a singular pose"
    REFLEX_ABORTED = "aborted by a reflex"
    EMERGENCY_ABORTED = "aborted by the emergency stop"
    INPUT_ERROR_ABORTED = "aborted: the commands were invalid"
    ABORTED = "aborted"
    MANUAL_RECOVERY = "a person must recover the robot in its web interface"


# In the order of their numbers on the wire.
_COMMANDS: dict[int, tuple[type[Body], ...]] = {
    5: (
        Connect, Move, StopMove, GetCartesianLimit, SetCollisionBehavior, SetJointImpedance, SetCartesianImpedance,
        SetGuidingMode, SetEEToK, SetNEToEE, SetLoad, SetFilters, AutomaticErrorRecovery, LoadModelLibrary,
    ),
    10: (
        Connect, Move, StopMove, SetCollisionBehavior, SetJointImpedance, SetCartesianImpedance, SetGuidingMode,
        SetEEToK, SetNEToEE, SetLoad, AutomaticErrorRecovery, GetRobotModel,
    ),
}  # fmt: skip

# Bytes after a reply's status if it is SUCCESS; None: any number; 0 for commands not listed.
PADDING = 3  # extra bytes allowed after a reply; libfranka accepts longer replies, and franka-sim sends them
_REPLY_DATA: dict[type[Body], int | None] = {
    GetCartesianLimit: 153, LoadModelLibrary: None, GetRobotModel: None,
}  # fmt: skip


def commands(version: int) -> tuple[type[Body], ...]:
    """Returns the commands of a protocol; a command's index is its number on the wire."""
    return _COMMANDS[version]


def statuses(version: int, command: type[Body]) -> tuple[Status, ...]:
    """Returns the meanings of a command's status byte; a status's index is its number on the wire."""
    return _STATUSES[version, command]


def _statuses_of(version: int, command: type[Body]) -> tuple[Status, ...]:
    S, safe = Status, version == 10
    if command is Connect:
        return S.SUCCESS, S.INCOMPATIBLE_VERSION
    if command is LoadModelLibrary:
        return S.SUCCESS, S.ERROR
    if command is Move:
        middle = (S.SAFETY_PREEMPTED, S.SAFETY_REJECTED) if safe else ()
        head = (S.SUCCESS, S.MOTION_STARTED, S.PREEMPTED, *middle, S.NOT_POSSIBLE, S.SINGULAR_POSE)
        return *head, S.INVALID_ARGUMENT, S.REFLEX_ABORTED, S.EMERGENCY_ABORTED, S.INPUT_ERROR_ABORTED, S.ABORTED
    refusals = (S.NOT_POSSIBLE, S.SAFETY_REJECTED) if safe else (S.NOT_POSSIBLE,)
    if command is StopMove:
        return S.SUCCESS, *refusals, S.EMERGENCY_ABORTED, S.REFLEX_ABORTED, S.ABORTED
    if command is AutomaticErrorRecovery:
        return S.SUCCESS, *refusals, S.MANUAL_RECOVERY, S.REFLEX_ABORTED, S.EMERGENCY_ABORTED, S.ABORTED
    return S.SUCCESS, S.NOT_POSSIBLE, S.INVALID_ARGUMENT, *((S.SAFETY_REJECTED,) if safe else ())


def _struct_of(version: int, command: type[Body]) -> struct.Struct:
    forms = [f.metadata["form"] for f in fields(command) if f.metadata["since"] <= version]
    return struct.Struct("<" + "".join(forms))


_STATUSES = {(v, command): _statuses_of(v, command) for v in VERSIONS for command in _COMMANDS[v]}
_STRUCTS = {(v, command): _struct_of(v, command) for v in VERSIONS for command in _COMMANDS[v]}


@dataclass(frozen=True, slots=True)
class Request:
    """A client's command; `number` is its counter, which the reply repeats."""

    number: int
    body: Body


@dataclass(frozen=True, slots=True)
class Reply:
    """The robot's answer to request `number`; `data` is the part after the status."""

    command: type[Body]
    number: int
    status: Status
    data: bytes = b""

    @property
    def version(self) -> int:
        """The robot's protocol version, in a reply to Connect."""
        return int(CONNECT_REPLY.unpack_from(self.data)[0])


def body_struct(version: int, command: type[Body]) -> struct.Struct:
    """Returns the layout of a request's body. Raises ValueError for a command this protocol doesn't have."""
    _number(version, command)
    return _STRUCTS[version, command]


def encode_request(version: int, number: int, body: Body) -> bytes:
    """Returns a request's bytes.

    Connect has the same layout in every protocol, and so has a Connect that names another version.

    Raises:
        ValueError: this protocol doesn't have the command.
        struct.error: a value is wrong.
    """
    layout = body_struct(version, type(body))
    values: list[Any] = []
    for f in fields(body):
        if f.metadata["since"] <= version:
            value = getattr(body, f.name)
            values.extend(value) if isinstance(value, tuple) else values.append(value)
    return HEADER.pack(_number(version, type(body)), number, HEADER.size + layout.size) + layout.pack(*values)


def encode_reply(version: int, reply: Reply) -> bytes:
    """Returns a reply's bytes. Raises ValueError for a command or a status this protocol doesn't have."""
    status = statuses(version, reply.command).index(reply.status)
    size = HEADER.size + 1 + len(reply.data)
    return HEADER.pack(_number(version, reply.command), reply.number, size) + bytes((status,)) + reply.data


def connect_reply(version: int, number: int, accepted: bool) -> bytes:
    """Returns the robot's answer to Connect: its own version, and whether the client's is the same."""
    status = Status.SUCCESS if accepted else Status.INCOMPATIBLE_VERSION
    return encode_reply(version, Reply(Connect, number, status, CONNECT_REPLY.pack(version)))


def _number(version: int, command: type[Body]) -> int:
    if version not in VERSIONS or command not in _COMMANDS[version]:
        raise ValueError(f"FCI protocol {version} has no {command.__name__}")
    return _COMMANDS[version].index(command)


class _Parser:
    """Cuts a stream into messages; bytes that can't be a header are skipped one by one.

    Attributes:
        frames: good messages.
        errors: messages of the right size with invalid content.
        resyncs: runs of bytes skipped in search of a header.
    """

    def __init__(self, version: int) -> None:
        self.version = version
        self.frames = 0
        self.errors = 0
        self.resyncs = 0
        self._commands = commands(version)
        self._buffer = bytearray()
        self._searching = False

    def _cut(self, data: bytes, fits: Callable[[type[Body], int], bool]) -> list[tuple[type[Body], int, bytes]]:
        """Returns the complete messages: command, counter, body.

        `fits` tells whether a command may have this total size.
        """
        buffer = self._buffer
        buffer += data
        cut = []
        at, end = 0, len(buffer)
        while end - at >= HEADER.size:
            command, number, size = HEADER.unpack_from(buffer, at)
            if command >= len(self._commands) or not fits(self._commands[command], size):
                self.resyncs += not self._searching
                self._searching = True
                at += 1
                continue
            if end - at < size:
                break
            self._searching = False
            cut.append((self._commands[command], number, bytes(buffer[at + HEADER.size : at + size])))
            at += size
        del buffer[:at]
        return cut


class RequestParser(_Parser):
    """The robot's side: parses a client's requests. A Connect with another version is a Request like any other."""

    def feed(self, data: bytes) -> list[Request]:
        """Takes any bytes and returns the requests they complete, oldest first. Never raises."""
        requests = []
        for command, number, body in self._cut(data, self._fits):
            requests.append(Request(number, self._decode(command, body)))
        self.frames += len(requests)
        return requests

    def _fits(self, command: type[Body], size: int) -> bool:
        return size == HEADER.size + body_struct(self.version, command).size

    def _decode(self, command: type[Body], body: bytes) -> Body:
        values = iter(body_struct(self.version, command).unpack(body))
        arguments: list[Any] = []
        for f in fields(command):
            if f.metadata["since"] <= self.version:
                count = f.metadata["form"][:-1]
                arguments.append(tuple(next(values) for _ in range(int(count))) if count else next(values))
        return command(*arguments)


class ReplyParser(_Parser):
    """The client's side: parses the robot's answers.

    `largest`: greatest number of bytes of a reply of any length (LoadModelLibrary, GetRobotModel). With 0 there are
    no such replies, and no false header can make the parser wait for more than 169 bytes.
    """

    def __init__(self, version: int, largest: int = 0) -> None:
        super().__init__(version)
        self._largest = largest

    def feed(self, data: bytes) -> list[Reply]:
        """Takes any bytes and returns the replies they complete, oldest first. Never raises."""
        replies = []
        for command, number, body in self._cut(data, self._fits):
            known = statuses(self.version, command)
            if body[0] >= len(known):
                self.errors += 1
                continue
            self.frames += 1
            size = CONNECT_REPLY.size if command is Connect else _REPLY_DATA.get(command, 0)
            replies.append(Reply(command, number, known[body[0]], body[1:] if size is None else body[1 : 1 + size]))
        return replies

    def _fits(self, command: type[Body], size: int) -> bool:
        rest = size - HEADER.size - 1
        if command is Connect:
            return 0 <= rest - CONNECT_REPLY.size <= PADDING
        usual = _REPLY_DATA.get(command, 0)
        if 0 <= rest <= PADDING:
            return True
        return 0 <= rest <= self._largest if usual is None else 0 <= rest - usual <= PADDING
