"""The live viewer: rerun's own server, shown in a browser. It gets a thinned stream."""

from __future__ import annotations

import numpy as np

from runtime.ipc.layout import Words
from runtime.recorder.stream import Stream
from runtime.recorder.tail import Batch
from runtime.recorder.viewer_server import ViewerServer

RATE = 100.0  # rows/s of the loop's clock that a viewer gets


class Viewer:
    """Sends a run to a server."""

    def __init__(self, text: str, newest: Words | None, server: ViewerServer) -> None:
        """`text` is the layout's JSON, `newest` a row (width,) if there is one. `server` listens."""
        self._server = server
        self._stream = Stream(text)
        self._stream.recording.connect_grpc(server.grpc)
        self._stream.prologue(newest, live=True)
        self._period = int(1e9 / RATE)
        self._bin = -1

    @property
    def alive(self) -> bool:
        """False once its server has ended."""
        return self._server.alive

    @property
    def problems(self) -> list[str]:
        """See `Stream.problems`."""
        return self._stream.problems

    def show(self, batch: Batch) -> None:
        """Shows the first row of each 1/RATE s, and all events."""
        if len(batch.rows):
            bins = self._stream.layout.word(batch.rows, "now") // self._period
            keep = bins != np.append(self._bin, bins[:-1])
            self._bin = int(bins[-1])
            self._stream.rows(batch.sequence[keep], batch.rows[keep])
        self._stream.events(batch.numbers, batch.events)

    def close(self) -> None:
        """Ends the server, once it has received what was sent."""
        if self.alive:
            self._stream.recording.disconnect()
        self._server.close()
