"""Checks whether this host is fit for a profile. Each finding states its meaning, a remedy, and a command for it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from srl.runtime.service.fitness import can, events, network, processor, serial, storage, unit
from srl.runtime.service.fitness.finding import Finding


@dataclass(frozen=True)
class Wanted:
    """What a run asks of its host.

    Attributes:
        rate: of the loop, Hz.
        ports: by device name, the port of each device that has one.
        inputs: the same of the devices that are input devices of the kernel (gamepads, rings).
        buses: bit rate by the URL of each CAN bus, bit/s.
        rows: bytes of the run's rows, in memory.
        state: the folder of what outlives a reboot.
        recordings: the folder where recordings go.
        listens: the bus's endpoints on the network.
    """

    rate: Fraction
    state: Path
    recordings: Path
    ports: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    buses: Mapping[str, float] = field(default_factory=dict)
    rows: int = 0
    listens: tuple[str, ...] = ()


def examine(wanted: Wanted) -> Iterator[Finding]:
    """Checks the host."""
    yield processor.kernel()
    yield from processor.rights()
    yield processor.throttling()
    yield from processor.timers()
    yield processor.governor()
    yield storage.memory(wanted.rows)
    yield from storage.leftovers()
    yield storage.state(wanted.state)
    yield storage.disk(wanted.recordings)
    yield processor.laws()
    yield unit.service()
    yield from serial.ports(wanted.ports)
    yield from events.inputs(wanted.inputs)
    yield from serial.latency(wanted.rate)
    yield from serial.rules(wanted.ports)
    yield from can.interfaces(wanted.buses)
    yield from network.devices(wanted.ports)
    yield from network.listens(wanted.listens)
    yield processor.jitter(wanted.rate)


def python() -> str:
    """The interpreter and the host, for the head of the report."""
    return f"Python {sys.version.split()[0]}, {os.cpu_count()} cores, Linux {os.uname().release}"
