"""The address of a zenoh peer and the protection of its link: options shared by drivers over zenoh."""

from __future__ import annotations

import ipaddress
import re
from typing import Any

from pydantic import Field, model_validator

from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.tls import TlsConfig

_NETWORK = re.compile(r"^(?P<protocol>tcp|tls)(?:/|://)(?P<host>\[[0-9a-fA-F:]+\]|[^:/\[\]?#]+):(?P<port>\d{1,5})$")
_SOCKET = "unixsock-stream/"
LEASE = 2000  # ms without a message after which the peer drops this side's declarations


class PeerConfig(DeviceConfig):
    """Options of a device that is reached over zenoh.

    Attributes:
        endpoint: `port` in zenoh's notation.
        host: the host in `port`; None for a Unix socket.
    """

    port: str = Field(description="tls://HOST:PORT, tcp://HOST:PORT or unixsock-stream/PATH")
    tls: TlsConfig | None = Field(None, description="ca, certificate, key: for tls")
    unencrypted_network: bool = Field(
        False, description="allows tcp:// to another host: anybody on that network can read, forge and command"
    )

    @model_validator(mode="after")
    def _protected(self) -> PeerConfig:
        if self.port.startswith(_SOCKET):
            return self
        match = _NETWORK.match(self.port)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise ValueError(f"port: '{self.port}' must read tls://HOST:PORT, tcp://HOST:PORT or {_SOCKET}PATH")
        if match["protocol"] == "tls" and self.tls is None:
            raise ValueError(f"port: '{self.port}' needs `tls:` with ca, certificate and key")
        if match["protocol"] == "tcp" and not self.unencrypted_network and not _is_loopback(match["host"]):
            raise ValueError(
                f"port: '{self.port}' crosses a network without protection; use tls://{match['host']}:{match['port']} "
                "with `tls:`, or accept it with `unencrypted_network: true`"
            )
        return self

    @property
    def endpoint(self) -> str:
        """See the class."""
        return self.port.replace("://", "/", 1)

    @property
    def host(self) -> str | None:
        """See the class."""
        match = _NETWORK.match(self.port)
        return match["host"].strip("[]") if match is not None else None


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def session_config(endpoint: str, tls: dict[str, str] | None, timeout: float) -> dict[str, Any]:
    """Returns a zenoh client's configuration: one endpoint, no scouting.

    Args:
        endpoint: in zenoh's notation.
        tls: `TlsConfig`'s fields.
        timeout: s to connect.
    """
    link: dict[str, Any] = {"tx": {"lease": LEASE, "keep_alive": 4}}
    if tls is not None:
        link["tls"] = {
            "root_ca_certificate": tls["ca"],
            "connect_certificate": tls["certificate"],
            "connect_private_key": tls["key"],
            "enable_mtls": True,
        }
    return {
        "mode": "client",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": round(timeout * 1000),
            "exit_on_failure": True,
            "retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        },
        "transport": {"shared_memory": {"enabled": False}, "link": link},
    }
