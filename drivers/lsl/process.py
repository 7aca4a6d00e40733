"""The process that holds liblsl for one driver: `python -m srl.drivers.lsl DESCRIPTOR`.

liblsl starts threads, opens sockets on every address, and blocks while it looks for streams and while it ends. So it is
alone here: started for one stream, and ended, without its help, when the driver closes or the stream is lost. It never
recovers a stream by itself (`recover=False`): what comes back is looked at anew, by the driver. A sample that can't be
passed on at once is dropped, and its number is missing.

Source: protocol sheet lsl, sections 3 to 7.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import time
from typing import Any, Final, NoReturn

import numpy as np

from srl.drivers.lsl import wire
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.exposure import refuse_strangers

POLL: Final = 0.002  # s between looks for samples
LOOK: Final = 1.0  # s between looks at the clock's offset and at the machine's addresses
BUFFERED: Final = 2  # s that liblsl keeps
RESOLVE: Final = 1.5  # s to look for the stream, and for another one that fits as well
ANSWER: Final = 3.0  # s for its description, its first connection, and its clock
_STRANGERS: Final = (
    "Run it in a network namespace or a service with an address filter (docs/devices/lsl.md), or accept the network "
    "with `unencrypted_network: true`"
)
_NONE: Final = "Start the sender, and compare its name, type and source id with the profile's `stream`"


def configuration(host: str, port: int, here: bool) -> str:
    """What liblsl reads in place of any file. Nothing is announced and nothing asked beyond `host`."""
    scope = (
        "ResolveScope=machine\nListenAddress=127.0.0.1\nAddressesOverride={127.0.0.1}" if here else "ResolveScope=link"
    )
    return (
        f"[ports]\nIPv6=disable\nMulticastPort={port}\nBasePort={port + 1}\nPortRange=32\nAllowRandomPorts=0\n"
        f"[multicast]\n{scope}\n[lab]\nKnownPeers={{{host}}}\nSessionID=default\n[log]\nlevel=-3\n"
    )


class Process:
    """See the module."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._number = 0

    def run(self) -> None:
        """Runs until the stream is lost or the driver's end is closed."""
        message = self._end.recv(1 << 16)
        if not message:
            return
        order = wire.Order(**wire.read(message).content)  # type: ignore[union-attr]
        addresses = self._confined(order, b"F", None)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # liblsl writes there, whatever its level
        import pylsl

        pylsl.set_config_content(configuration(order.host, order.port, order.here))
        inlet = self._opened(pylsl, order)
        self._follow(pylsl, inlet, order, addresses)

    def _confined(self, order: wire.Order, kind: bytes, tried: list[str] | None) -> list[str]:
        if order.exposed:
            return []
        try:
            return refuse_strangers(_STRANGERS, tried)
        except RequestError as error:
            self._end_with(kind, error.problem, error.remedy)

    def _opened(self, lsl: Any, order: wire.Order) -> Any:
        """The inlet of the one stream that fits, with samples on their way."""
        found = lsl.resolve_bypred(order.predicate, 2, RESOLVE)
        if not found:
            others = [f"{s.name()} ({s.type()}, source_id {s.source_id()!r})" for s in lsl.resolve_streams(1.0)]
            listed = "; there are: " + ", ".join(sorted(others)[:8]) if others else "; there is no stream at all"
            self._end_with(b"F", f"no stream has {order.predicate}{listed}", _NONE)
        if len(found) > 1:
            places = ", ".join(sorted(f"{s.name()} of {s.hostname()}" for s in found))
            remedy = "Say more under `stream` (source_id, hostname), or end the other one"
            self._end_with(b"F", f"{len(found)} streams have {order.predicate}: {places}", remedy)
        if found[0].channel_format() == lsl.cf_string:
            self._end_with(b"F", "it sends texts (markers), which are no signal", "Record it, beside this")
        try:
            inlet = lsl.StreamInlet(found[0], max_buflen=BUFFERED, recover=False)
            info = inlet.info(ANSWER)
            inlet.open_stream(ANSWER)
            self._offset(inlet, order, ANSWER)
        except (lsl.util.TimeoutError, lsl.util.LostError) as error:
            self._end_with(
                b"F", f"it is announced, and doesn't answer ({error})", "Restart the sender; look at firewalls"
            )
        n = info.channel_count()
        both = info.get_channel_labels(), info.get_channel_units()  # None where none is stated
        labels, units = ([word or "" for word in given or []] for given in both)
        self._say(
            wire.words(
                b"R",
                {
                    "name": info.name(), "type": info.type(), "source_id": info.source_id(), "uid": info.uid(),
                    "hostname": info.hostname(), "rate": info.nominal_srate(), "count": n,
                    "labels": labels if len(labels) == n else [], "units": units if len(units) == n else [],
                },
            )
        )  # fmt: skip
        return inlet

    def _follow(self, lsl: Any, inlet: Any, order: wire.Order, addresses: list[str]) -> None:
        offset = self._offset(inlet, order, ANSWER)
        due = time.monotonic() + LOOK
        while True:
            try:
                values, stamps = inlet.pull_chunk(timeout=0.0, max_samples=1024)
            except lsl.util.LostError:
                self._end_with(b"X", "the stream has ended", "Start its sender again")
            if stamps:
                # float64 holds every number of the formats but int64's beyond 2**53, which is no measurement.
                item = wire.Data(self._number, time.monotonic_ns(), offset, np.array(stamps), np.array(values, float))
                self._number += len(stamps)
                for message in wire.data(item):
                    self._say(message)
            if (now := time.monotonic()) >= due:
                due = now + LOOK
                offset = self._offset(inlet, order, 0.0, offset)
                if not order.here and inlet.was_clock_reset():
                    self._end_with(b"X", "the sender's clock began anew", "It is opened again")
                addresses = self._confined(order, b"X", addresses)
            if select.select([self._end], [], [], 0.0 if stamps else POLL)[0]:
                return  # the driver has closed; it says nothing else

    @staticmethod
    def _offset(inlet: Any, order: wire.Order, timeout: float, last: float = 0.0) -> float:
        """s to be added to the stamps; 0 on this machine, where both clocks are CLOCK_MONOTONIC (section 3)."""
        if order.here:
            return 0.0
        import pylsl

        try:
            return float(inlet.time_correction(timeout or 0.001))
        except (pylsl.util.TimeoutError, pylsl.util.LostError):  # a loss is found by the next pull, too
            if timeout:
                raise
            return last

    def _say(self, message: bytes) -> None:
        try:
            self._end.send(message, socket.MSG_DONTWAIT)
        except BlockingIOError:
            pass  # the driver doesn't read; the next sample is newer
        except OSError:
            os._exit(0)

    def _end_with(self, kind: bytes, problem: str, remedy: str) -> NoReturn:
        self._say(wire.words(kind, {"problem": problem, "remedy": remedy}))
        os._exit(0)  # liblsl's own end may take its time


def main(arguments: list[str]) -> int:
    """Runs the process. Returns the exit code."""
    if len(arguments) != 1 or not arguments[0].isdigit():
        print("usage: python -m srl.drivers.lsl DESCRIPTOR", file=sys.stderr)
        return 2
    end = socket.socket(fileno=int(arguments[0]))
    os.set_inheritable(end.fileno(), False)
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the run, and so this
    Process(end).run()
    os._exit(0)
