"""Live parameters, set over the run's bus as `srl set` does, in a thread of their own: the bus may take its time."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import zenoh

from srl.runtime.bus.client import Client, connect
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.run_folder import RunFolder


class Parameters:
    """The parameters of one run. `thread`: the only one that may call `change` and `close`."""

    def __init__(self, run_folder: RunFolder) -> None:
        self._folder = run_folder
        self._client: Client | None = None
        self.thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="parameters")

    @staticmethod
    def described(layout: Layout) -> list[dict[str, Any]]:
        """Name, bounds, unit, text and default of each; a bound that isn't finite is None."""
        keys = ("name", "lower", "upper", "unit", "text", "default")
        return [
            {key: _finite(entry.get(key)) for key in keys}
            for entry in layout.meta.get("parameters", [])
            if entry["name"] in layout.fields
        ]

    @staticmethod
    def values(layout: Layout, row: Words) -> list[float | None]:
        """What the loop has of each in a row (width,): None for a number that isn't finite."""
        names = [e["name"] for e in layout.meta.get("parameters", []) if e["name"] in layout.fields]
        return [_finite(float(layout.value(row, name).ravel()[0])) for name in names]

    def change(self, name: str, value: float) -> float:
        """Sets one, and returns what the loop has then. Raises RequestError: it is refused, with the reason."""
        if not self._folder.bus_socket.exists():
            self.close()
            remedy = "Add `bus: {}` to its profile, and run it again"
            raise RequestError(f"parameter '{name}'", "the run has no bus, over which parameters are set", remedy)
        try:
            if self._client is None:
                self._client = connect(self._folder)
            return float(self._client.set_param(name, value, "the panel")["value"])
        except RequestError:
            self.close()  # the next one finds a bus that was started again
            raise
        except zenoh.ZError as error:
            self.close()
            raise RequestError(f"parameter '{name}'", f"the bus fails: {error}", "Try again") from None

    def close(self) -> None:
        """Ends the session with the bus: a process that leaves one open hangs at its end."""
        if self._client is not None:
            self._client.close()
            self._client = None


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
