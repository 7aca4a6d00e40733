"""Whatever bytes come from a device's wire: its driver raises only its own errors, and no absurd value is used."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from random import Random
from typing import Any, Final

import can
import numpy as np
import pytest

from srl.drivers.canbus import CanLink
from srl.drivers.datagram import Datagrams
from srl.drivers.transport.base import Transport
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.plausible import plausible
from srl.runtime.ipc.header import DEVICE as WORD
from srl.runtime.ipc.header import LINK_ERROR
from srl.runtime.loop.device import Device
from srl.runtime.testing.twin_bench import TwinBench
from srl.sim.devices.examples import DEVICES
from srl.studies.faults.wire_trial import CYCLE, NOT, _driver, _twin

KINDS: Final = sorted(set(DEVICES) - set(NOT))
READS: Final = 400
RATE: Final = 0.15  # of the reads that bring something else
FLOATS: Final = (math.nan, math.inf, -math.inf, 1e30, 3e38, 1e-42, 1e6, -1e6, 0.0)
WHOLE: Final = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFF, 0x8000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)


class Noise:
    """Changes what comes, once it is on."""

    def __init__(self, seed: str) -> None:
        self.random, self.on = Random(seed), False

    def changed(self, data: bytes) -> bytes:
        r = self.random
        if not self.on or not data or r.random() > RATE:
            return data
        made = bytearray(data)
        for _ in range(r.choice((1, 1, 1, 2, 4, 12))):
            at, order = r.randrange(len(made) + 1), r.choice("<>")
            kind = r.randrange(8)
            if kind == 0 and at < len(made):
                made[at] ^= 1 << r.randrange(8)
            elif kind == 1:
                del made[at : at + r.choice((1, 2, 4, 8, 50))]
            elif kind == 2:
                made[at:at] = r.randbytes(r.choice((1, 2, 4, 8)))
            elif kind == 3:
                made[at : at + 4] = struct.pack(order + "f", r.choice(FLOATS))
            elif kind == 4:
                made[at : at + 8] = struct.pack(order + "d", r.choice(FLOATS))
            elif kind == 5:
                made[at : at + 4] = struct.pack(order + "I", r.choice(WHOLE))
            elif kind == 6:
                made += bytes(made)
            else:
                del made[at:]
            if not made:
                break
        return bytes(made)

    def of_can(self, message: can.Message) -> can.Message:
        data = self.changed(bytes(message.data))[:8]
        return can.Message(
            arbitration_id=message.arbitration_id, is_extended_id=message.is_extended_id, data=data,
            is_remote_frame=message.is_remote_frame, timestamp=message.timestamp,
        )  # fmt: skip


@pytest.fixture
def noise(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Noise:
    """Between each wire and its driver."""
    made = Noise(request.node.name)

    def between(cls: Any, name: str, change: Callable[[Any], Any]) -> None:
        read = getattr(cls, name)
        monkeypatch.setattr(cls, name, lambda self: change(read(self)))

    between(Transport, "read", made.changed)
    between(Datagrams, "read_from", lambda found: [(made.changed(data), peer) for data, peer in found])
    between(CanLink, "read", lambda found: [made.of_can(each) if made.on else each for each in found])
    return made


def absurd(driver: Driver) -> list[str]:
    """What of its states can't be."""
    found = []
    for signal in driver.states:
        low, high = plausible(signal)
        values = driver.state_arrays[signal.name].ravel()
        with np.errstate(invalid="ignore"):
            if ((values < low) | (values > high)).any() and np.isfinite(values).all():
                found.append(f"{signal.name}: {values}")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_on_a_wire_is_an_error_of_the_driver_or_an_absurd_value(kind: str, noise: Noise) -> None:
    left = READS
    for _ in range(40):  # each time that it is lost, it is opened anew
        noise.on = False
        events: list[str] = []
        with TwinBench.of(_twin(kind)) as bench:
            driver = _driver(kind, bench.address)
            device = Device(driver, np.zeros(len(WORD), np.int64), [], events.append)
            try:
                with bench.serving():
                    driver.open()
                for _ in range(20):
                    bench.run(CYCLE)
                    device.read(bench.now)
                noise.on = True
                while left > 0 and not device.lost:
                    left -= 1
                    bench.run(CYCLE)
                    device.read(bench.now)
                    assert not device.header.item(WORD.link) & LINK_ERROR, events[-1]
                    assert not absurd(driver)
                    assert device.header.item(WORD.stamp) <= bench.now
            except DeviceError:
                pass  # it was lost while it was opened
            finally:
                noise.on = False
                driver.close()
        if left <= 0:
            return
    assert left < READS
