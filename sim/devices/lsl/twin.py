"""The program that sends a stream: an outlet of pylsl, with the channels that the profile asks for.

liblsl can't be bound to loopback, and takes its configuration once in a process. So the twin only begins where no other
machine could reach it, and a process has one discovery port.
"""

from __future__ import annotations

import importlib.util
from functools import cache
from typing import Any, Final

from srl.drivers.lsl.process import configuration
from srl.drivers.lsl.units import factor
from srl.runtime.contracts.errors import HostError, RequestError
from srl.runtime.contracts.exposure import refuse_strangers
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Twin
from srl.sim.devices.lsl.fake import FakeLsl
from srl.sim.devices.shared.sockets import free_port
from srl.sim.devices.shared.windows import Plug

_CONFINE: Final = "Run it in a network namespace: unshare -rn sh -c 'ip link set lo up; srl twin ...'"
_CATCH_UP: Final = 0.5  # s of samples that are sent late; then they are left out
_BUFFERED: Final = 5  # s


class LslTwin(Twin):
    """Sends the fake's samples, in the sender's units, stamped when they were taken, as a good outlet does.

    Attributes:
        muted: it sends nothing, and its outlet stays.
        uids: of its outlets so far; each start has another.
        rate, count, unit: what it says in place of what is right; None: what is right. They count from the next start.
        stamp_error: s, added to its stamps.
    """

    def __init__(self, fake: FakeLsl) -> None:
        super().__init__(fake)
        self._fake, self._config = fake, fake.stream
        self.muted = False
        self.uids: list[str] = []
        self.rate: float | None = None
        self.count: int | None = None
        self.unit: str | None = None
        self.stamp_error = 0.0
        self._outlet: Any = None
        self._sent = 0
        self._last = -1
        self._plug = Plug(fake)
        self._columns = fake.columns

    def open(self) -> None:
        """Raises:
        HostError: pylsl isn't installed, or other machines could reach it.
        """
        if importlib.util.find_spec("pylsl") is None:
            raise HostError("the twin of lsl", "the package pylsl isn't installed", "pip install 'srl-runtime[lsl]'")
        try:
            refuse_strangers(_CONFINE)
        except RequestError as error:
            raise HostError("the twin of lsl", error.problem, error.remedy) from None
        lsl, port = _library()
        self._outlet = lsl.StreamOutlet(self._info(lsl), chunk_size=0, max_buffered=_BUFFERED)
        self.uids.append(self._outlet.get_info().uid())
        self._last = self._fake.newest()
        self.address = f"lsl://127.0.0.1:{port}"

    def close(self) -> None:
        """Readers see the stream end."""
        self._outlet = None
        self.address = ""

    def restart(self) -> None:
        """The program is started again: the same source id, another uid."""
        self.close()
        self.open()

    def service(self, now: int) -> None:
        fake = self._fake
        self._plug.follow(self.close, self.open)
        newest = fake.newest()
        first = max(self._last + 1, newest - int(_CATCH_UP * fake.rate), 0)
        self._last = newest
        if self._outlet is None or self.muted:
            return
        chunk, stamp = [], 0.0
        for number in range(first, newest + 1):
            values = fake.sample(number) if fake.samples.keeps(number) else None
            if values is not None:
                chunk.append(self._sender(values))
                stamp = (now - (fake.world.time - fake.taken_at(number))) * 1e-9 + self.stamp_error
        if chunk:
            self._outlet.push_chunk(chunk, stamp)  # the newest's; liblsl counts back by the rate
            self._sent += len(chunk)

    def metrics(self) -> dict[str, object]:
        """Samples sent, and whether anybody reads."""
        return {"sent": self._sent, "read": self._outlet is not None and bool(self._outlet.have_consumers())}

    def _sender(self, values: Array) -> list[float]:
        out = [0.0] * (self.count or max(self._config.count or 0, max(self._columns) + 1))
        at = 0
        for entry in self._config.signals.values():
            by = _factor(entry.sent, entry.unit)
            for _ in entry.channels:
                if self._columns[at] < len(out):
                    out[self._columns[at]] = float(values[at] / by)
                at += 1
        return out

    def _info(self, lsl: Any) -> Any:
        config, stream = self._config, self._config.stream
        count = self.count or max(config.count or 0, max(self._columns) + 1)
        rate = config.rate if self.rate is None else self.rate
        info = lsl.StreamInfo(
            stream.name or "twin", stream.type or "Misc", count, rate, lsl.cf_double64, stream.source_id or "srl-twin"
        )
        labels, units, at = [""] * count, [""] * count, 0
        for entry in config.signals.values():
            for name, where in entry.channels.items():
                if self._columns[at] < count:
                    labels[self._columns[at]] = where if isinstance(where, str) else ""
                    units[self._columns[at]] = self.unit or ("" if entry.sent else entry.unit_of(name))
                at += 1
        channels = info.desc().append_child("channels")
        for label, unit in zip(labels, units, strict=True):
            one = channels.append_child("channel")
            for key, value in (("label", label), ("unit", unit)):
                if value:
                    one.append_child_value(key, value)
        return info


def _factor(sent: str | None, unit: str) -> float:
    return (factor(sent, unit) if sent is not None else None) or 1.0


@cache
def _library() -> tuple[Any, int]:
    """pylsl, and this process' discovery port."""
    import pylsl

    port = _free()
    pylsl.set_config_content(configuration("127.0.0.1", port, here=True))
    return pylsl, port


def _free() -> int:
    """A discovery port that nobody has, with room for the streams' after it."""
    return min(free_port(), 64000)
