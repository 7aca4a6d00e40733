"""The header fields of a row (int64): their places by name, and the meaning of their numbers.

`CYCLE.now` is the place of the field `now` in a row's header. `DEVICE.link` is the place of the field `link`
among those of one device (`srl.runtime.ipc.row.Row.devices`, `srl.runtime.ipc.layout.Layout.device`).
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Final, NamedTuple


class CycleHeader(NamedTuple):
    """Header fields of the cycle itself.

    Times are in ns: `now` on the loop's clock; `deadline`, `wake` and the ends of the phases on
    CLOCK_MONOTONIC; `log` is the time it took to append the previous row. `request` to `request_result` and
    `request_origin` describe the request that this cycle took. `refused` counts all requests refused so far.
    New fields are added at the end: a recording says which of them it has.
    """

    cycle: int
    now: int
    dt: int
    deadline: int
    wake: int
    read: int
    control: int
    guard: int
    write: int
    log: int
    state: int
    cause: int
    fault_source: int
    category: int
    overruns: int
    flags: int
    request: int
    request_kind: int
    request_target: int
    request_result: int
    request_origin: int
    latches: int
    refused: int


class DeviceHeader(NamedTuple):
    """Words of one device, from its driver's `Health`. A row has one set for each device.

    `commands` counts the cycles in which a command left for the device.
    """

    stamp: int
    link: int
    frames: int
    errors: int
    resyncs: int
    reconnects: int
    commands: int


CYCLE: Final = CycleHeader(*range(len(CycleHeader._fields)))
DEVICE: Final = DeviceHeader(*range(len(DeviceHeader._fields)))

# Bits of `flags`.
FLAG_LATE = 1  # this cycle began after its deadline by more than a period
FLAG_DEGRADED = 2  # overruns: telemetry must reduce its load
FLAG_REJECTED = 4  # the guard refused a command: it was not finite, or a measurement for it was not finite or old
FLAG_FALLBACK = 8  # the guard braked because its trajectory generator failed
FLAG_LIMITED = 16  # the guard changed a command
FLAG_RESYNCHRONISED = 32  # the guard began anew at what was sent: the link or the device didn't take its commands
FLAG_HELD = 64  # nothing that was asked is clear of what the limb must keep clear of: it brakes or waits
# Bits of a device's `link`.
LINK_CONNECTED = 1
LINK_STALE = 2
LINK_ACTIVE = 4  # commands are sent to it
LINK_ERROR = 8  # its driver raised an unexpected error
LINK_FAULT = 16  # it is connected and refuses to move until it has recovered


class State(IntEnum):
    """The states of the state machine."""

    STARTING = 0
    READY = 1  # devices open, nothing moves
    ACTIVE = 2
    STOPPING = 3  # a stop is in progress
    STOPPED = 4  # at rest after a stop; waits for a reset
    ENDED = 5
    HOMING = 6  # a device without feedback goes to its home slowly


class Cause(IntEnum):
    """The cause of a stop."""

    NONE = 0
    REQUEST = 1  # a client, `srl stop`, SIGTERM
    INTENT_LOSS = 2  # a sensor that the motion follows is stale or lost
    DEVICE_LOSS = 3  # an actuator, or the device of an emergency input, is stale or lost
    OVERRUN = 4
    DRIVER_ERROR = 5
    CONTROLLER_ERROR = 6
    EMERGENCY = 7  # an e-stop or enabling input
    BUS_LOSS = 8  # the bus died, and the profile depends on it
    SUPERVISOR_LOSS = 9
    RESTART = 10  # started again after a crash
    END = 11  # the run's duration is over
    DEVICE_FAULT = 12  # a device refuses to move: protective stop, reflex, hardware error
    CONTACT = 13  # a law found contact that must not be
    FOLLOWING_ERROR = 14  # a limb isn't where its command is, or can't start from where it is measured


class Origin(IntEnum):
    """Where a request came from. The receiver decides it; no sender can claim it."""

    NONE = 0  # no request
    LOCAL = 1  # a process of this machine, through the loop's sockets: `srl stop`
    INPUT = 2  # a button that the profile names under `reset:`
    BUS = 3  # a client of the bus
    SERVICE = 4  # the service itself: the supervisor, SIGTERM, the end of the duration
    OPERATOR = 5  # a client of the bus from the network, whose certificate has this role
    ENGINEER = 6  # likewise
    OBSERVER = 7  # likewise; it may only read


CLIENTS = frozenset(
    {Origin.BUS, Origin.OBSERVER, Origin.OPERATOR, Origin.ENGINEER}
)  # whose requests come through the bus


class Latch(IntFlag):
    """What keeps a stop after its cause has gone. `srl.runtime.ipc.latches` says who may end which."""

    PERSON = 1  # a person's stop on this machine
    BUS = 2  # a stop by a client of the bus
    EMERGENCY = 4  # an emergency input
    FAULT = 8  # any fault that stopped the limb
    RESTART = 16  # the run before ended badly
    START = 32  # the run waits for a person's first start
