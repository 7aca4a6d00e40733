"""An instance's rows as a stream of the Lab Streaming Layer (LSL), for a lab's recorder. It only reads.

Its stamps are of CLOCK_MONOTONIC, as LSL's own clock. liblsl has many threads, and listens on every address of the
machine, without a password: so it is in a process of its own, and `srl.runtime.contracts.exposure` says who could read
it. There is one stream: of several in a process, a search that comes by 127.0.0.1 finds one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Final

from srl.runtime.contracts.errors import RecordingError, RequestError
from srl.runtime.export.lsl_channels import Channels
from srl.runtime.export.report import needed
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.rows import Rows
from srl.runtime.ipc.run_folder import RunFolder

BUFFERED: Final = 5  # s that a slow reader may be behind; liblsl keeps that in memory for each
_CONFINED: Final = """
[ports]
IPv6=disable
AllowRandomPorts=0
[multicast]
ResolveScope=machine
ListenAddress=127.0.0.1
[log]
level=-1
"""
_EXPOSED: Final = """
[ports]
AllowRandomPorts=0
[log]
level=-1
"""


def load(exposed: bool) -> ModuleType:
    """pylsl, told not to read any configuration of the machine or of the folder.

    Args:
        exposed: it is announced in the network, not only on this machine.
    Raises:
        HostError: the package isn't installed.
    """
    lsl = needed("pylsl", "srl lsl")
    lsl.set_config_content(_EXPOSED if exposed else _CONFINED)
    return lsl


class Outlet:
    """The stream of an instance, also when its loop is started again.

    Attributes:
        sent: rows so far.
        description: the stream for a person; it changes with a new run.
        lack: why nothing of the present run is sent; empty if it is sent.
    """

    def __init__(self, lsl: ModuleType, run_folder: RunFolder, references: Sequence[str]) -> None:
        """Opens rows and stream.

        Args:
            lsl: what `load` gave.
            run_folder: the instance's folder.
            references: signals, or parts of them, as `record.plots` names them.
        Raises:
            RecordingError: there is no run, or its rows lack a signal.
            RequestError: an element is asked for twice.
        """
        self._lsl, self._instance, self._references = lsl, run_folder.path.name, references
        self.sent, self.lack = 0, ""
        self._rows = Rows(run_folder, self._fits)
        self._stream: Any = None
        self._open()

    @property
    def lost(self) -> int:
        """Rows that were overwritten before they could be sent."""
        return self._rows.lost

    def follow(self, now: float) -> None:
        """Sends what is new. `now`: CLOCK_MONOTONIC s."""
        rows = self._rows.take(now)
        layout = self._rows.layout
        if layout is not self._layout:
            self._open()
        if not len(rows):
            return
        # In a simulation as fast as it goes `now` is simulated time, which no other stream of a lab has.
        clock = "control" if layout.meta.get("unpaced") else "now"
        stamps = layout.header(rows, clock) / 1e9
        self._stream.push_chunk(self._channels.values(layout, rows), stamps.tolist())
        self.sent += len(rows)

    def close(self) -> None:
        """Ends the stream and unmaps the rows."""
        self._stream = None
        self._rows.close()

    def _fits(self, layout: Layout) -> None:
        try:
            Channels.of(layout, self._references)
        except (RecordingError, RequestError) as error:
            self.lack = str(error)
            raise
        self.lack = ""

    def _open(self) -> None:
        """Opens the stream of the rows' present layout."""
        lsl, layout = self._lsl, self._rows.layout
        self._stream = None  # its ports are free before the next one opens
        self._layout, self._channels = layout, Channels.of(layout, self._references)
        rate = layout.meta["rate"][0] / layout.meta["rate"][1]
        name, count = f"srl {self._instance}", len(self._channels.names)
        # A recorder that lost a stream goes on with one of the same id and number of channels, under the old labels.
        meant = repr((self._channels.names, self._channels.units))
        identity = f"srl/{self._instance}/{hashlib.sha256(meant.encode()).hexdigest()[:8]}"
        info = lsl.StreamInfo(name, "Robot", count, rate, lsl.cf_double64, identity)
        _describe(info, layout, self._channels)
        self._stream = lsl.StreamOutlet(info, max_buffered=BUFFERED)
        self.description = f"the stream '{name}': {count} channels at {rate:g} Hz"


def _describe(info: Any, layout: Layout, channels: Channels) -> None:
    """Writes what a reader may want to know into the stream's description, as XDF's meta-data pages have it."""
    desc = info.desc()
    acquisition = desc.append_child("acquisition")
    facts = {"manufacturer": "srl", "model": layout.meta["name"], "profile_sha256": layout.meta["sha256"]}
    for key, value in (facts | {"simulated": " ".join(layout.simulated)}).items():
        acquisition.append_child_value(key, value)
    for words in (State, Cause):  # what the numbers of two channels mean
        listed = desc.append_child(f"{words.__name__.lower()}s")
        for word in words:
            listed.append_child_value(word.name.lower(), str(int(word)))
    listed = desc.append_child("channels")
    for name, unit in zip(channels.names, channels.units, strict=True):
        one = listed.append_child("channel")
        for key, value in (("label", name), ("unit", unit), ("type", "Misc")):
            one.append_child_value(key, value)
