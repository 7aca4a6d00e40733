"""A client of a running instance's bus: states, events, requests, setpoints (docs/bus.md)."""

from runtime.bus.client import Client, Update, connect

__all__ = ["Client", "Update", "connect"]
