"""A stream of the Lab Streaming Layer as a device: channels by name, ages by the sender's stamps."""

from __future__ import annotations

import importlib.util
from typing import Any, Final, cast

import numpy as np

from srl.drivers.helper_process import HelperProcess, ProcessEndedError
from srl.drivers.linked import Addressed
from srl.drivers.lsl import wire
from srl.drivers.lsl.config import LslConfig
from srl.drivers.lsl.match import match
from srl.drivers.lsl.rows import Rows
from srl.drivers.rate import Rate
from srl.drivers.timeout import remaining
from srl.runtime.contracts.driver import Sensor

START: Final = 15.0  # s for the process to begin, find the stream and describe it
FIRST: Final = 3.0  # s for a regular stream's first sample
MOST: Final = 64  # messages in one read
CLOCK: Final = 5.0  # s; stamps that are further away aren't of LSL's clock
AHEAD: Final = 100_000_000  # ns by which a stamp may be later than its arrival, by an error of the clocks' offset
_SENDER: Final = "Look at the sender, its sensors and its network"


class Lsl(Addressed, Sensor):
    """One stream of the Lab Streaming Layer; the states are those that the profile lists.

    A state is (n,), the newest sample, or with `block: k` (k, n), the newest k samples, oldest first, beside `count`
    (1,), how many there have been. Where samples are missing, `count` grows by more than a block holds, so that no law
    filters across. A sample with a value that isn't finite isn't taken, unless its signal says `nan: true`: then the
    device becomes stale.

    liblsl runs in a process of its own, which only passes samples on. A stream that ends, falls silent, comes at
    another rate or is looked up anew as another one is a loss, and the runtime opens it again: then name, channels,
    rate and units are compared with the profile anew.

    Source: protocol sheet lsl.
    """

    Config = LslConfig
    gives = ("<signal>", "count")
    summary = "any stream of the Lab Streaming Layer (LSL): EMG, EEG, gaze, motion capture"
    max_age = 0.2
    here = False

    def __init__(self, name: str, config: LslConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self.states = config.states()
        self._helper = HelperProcess(self._place, "srl.drivers.lsl", "LSL process")
        self._rows = Rows(config, {})
        self._latency, self._silence = round(config.latency * 1e9), round(config.silence * 1e9)
        self._uid = ""
        self._forget()

    def _forget(self) -> None:
        self._rate = Rate(self._config.rate)
        self._next: int | None = None  # number of the sample that must come next
        self._heard = -1  # ns, the loop's clock
        self._problem = ""  # of the newest sample
        self._kept: list[wire.Data] = []  # came while it was opened

    def open(self) -> None:
        """Blocks up to 18 s.

        Raises:
            DeviceError: pylsl isn't installed; other machines could reach liblsl; no such stream, or two; another
                rate, number of channels, label or unit; stamps of another clock.
        """
        if importlib.util.find_spec("pylsl") is None:
            raise self._error("the package pylsl isn't installed", "pip install 'srl-runtime[lsl]'")
        self.close()
        config = self._config
        try:
            self._helper.ensure()
            wanted, exposed = config.stream.predicate(), config.unencrypted_network
            order = wire.Order(config.host, config.number, exposed, config.here, wanted)
            self._helper.tell(wire.words(b"O", order._asdict()))
            description = cast(wire.Words, self._await(START, "R"))
            self._rows = Rows(config, match(self._place, config, description.content))
            if config.rate:
                self._check_clock(cast(wire.Data, self._await(FIRST, "D")))
        except ProcessEndedError:
            self.close()
            problem, remedy = "its LSL process has ended", "Look at the host's memory and limits"
            raise self._error(problem, remedy) from None
        except BaseException:
            self.close()
            raise
        uid = str(description.content["uid"])
        self.health.message = "the sender has started anew" if self._uid not in ("", uid) else ""
        self._uid = uid
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected:
            raise self._not_open()
        arrived, self._kept = self._kept, []
        try:
            for _ in range(MOST):
                message = self._helper.take()
                if message is None:
                    break
                item = wire.read(message)
                if isinstance(item, wire.Words):
                    raise self._lost(item.content["problem"], item.content["remedy"])
                arrived.append(item)
        except ProcessEndedError:
            raise self._lost("its LSL process has ended", "It is started again") from None
        for item in arrived:
            self._take(item)
        if arrived or self._heard < 0:
            self._heard = now
        elif self._config.rate and now - self._heard > self._silence:
            raise self._lost(f"nothing came for {self._config.silence:g} s", _SENDER)

    def close(self) -> None:
        self.health.connected = False
        self._helper.kill()
        self._forget()

    def pid(self) -> int | None:
        """The id of its process, for tests."""
        return self._helper.pid()

    # -- samples

    def _take(self, item: wire.Data) -> None:
        gap = item.number != self._next  # the first of all, too: what a block holds is of before
        self._next = item.number + len(item.stamps)
        stamps = np.rint((item.stamps + item.offset) * 1e9)
        good, problem = self._rows.take(self.state_arrays, item.values, stamps <= item.arrived + AHEAD, gap)
        self.health.frames += int(good.sum())
        self.health.errors += int((~good).sum())
        if good.any():
            stamp = min(int(stamps[good][-1]), item.arrived) - self._latency
            self.health.stamp = max(self.health.stamp, stamp)
        if problem or self._problem:
            self.health.message = self._problem = problem
        found = self._rate.wrong(self._next, item.arrived) if self._config.rate else None
        if found is not None:
            raise self._lost(f"it brings {found:.0f} samples a second, and says {self._config.rate:g}", _SENDER)

    # -- opening

    def _await(self, timeout: float, kind: str) -> wire.Words | wire.Data:
        """The description ("R") or samples ("D"). Raises DeviceError: the process says why not, or nothing."""
        for rest in remaining(timeout):
            message = self._helper.take()
            if message is None:
                self._helper.wait(rest)
                continue
            item = wire.read(message)
            if isinstance(item, wire.Data):
                self._kept.append(item)
                if kind == "D":
                    return item
            elif item.kind == b"R":
                return item
            else:
                raise self._error(item.content["problem"], item.content["remedy"])
        if kind == "D":
            raise self._error(f"the stream is there, and sends nothing within {timeout:g} s", _SENDER)
        self._helper.end_hanging()

    def _check_clock(self, item: wire.Data) -> None:
        age = item.arrived * 1e-9 - (item.stamps[-1] + item.offset)
        if not abs(age) < CLOCK:
            way = f"{age:.0f} s old" if age > 0 else f"{-age:.0f} s in the future"
            problem = f"its stamps are {way} on arrival: they aren't of LSL's clock"
            raise self._error(problem, "Let the sender stamp by local_clock(), or leave the stamp to LSL")

    def metrics(self) -> dict[str, Any]:
        """Returns the stream's uid: another one is another start of its sender."""
        return {"uid": self._uid}
