"""A client of a running instance's bus: states, events, requests, setpoints; over a network with TLS (docs/bus.md)."""

from srl.runtime.bus.client import Client, Update, connect
from srl.runtime.contracts.tls import TlsConfig

__all__ = ["Client", "TlsConfig", "Update", "connect"]
