"""The profile's `bus:` section: closed by default, open to the network only with mutual TLS."""

from __future__ import annotations

import ipaddress
import re
from typing import Any, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.tls import TlsConfig

_ENDPOINT = re.compile(r"^(?P<protocol>tcp|tls)/(?P<host>\[[0-9a-fA-F:]+\]|[^:/\[\]?#]+):(?P<port>\d{1,5})$")


class Ros2Config(BaseModel):
    """`bus.ros2`: the run as a node of ROS 2, for peers with rmw_zenoh. `ros2: true` takes the defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    router: str = Field("tcp/127.0.0.1:7447", description="the zenoh router that ROS 2 uses: tcp/HOST:PORT, tls/...")
    domain: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID")
    namespace: str | None = Field(
        None,
        pattern=r"^(|/[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)$",
        description="of the node: '/left'; null: the instance's name; '': none",
    )
    distribution: Literal["humble", "jazzy", "kilted", "lyrical"] = Field("jazzy", description="of the ROS 2 peers")
    rate: float = Field(50.0, gt=0.0, le=1000.0, description="Hz, at which topics are published, at most")
    commands: bool = Field(
        False,
        description="whether any peer of the router may start, stop, reset the limb, send its setpoints and set its "
        "parameters",
    )
    allow_partial_joints_goal: bool = Field(
        False, description="whether a command may leave joints out, which then stay where they were sent last"
    )


class BusConfig(BaseModel):
    """`bus`: what the bus publishes, and where it listens in addition to its own Unix socket."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    decimate: int = Field(10, ge=1, description="every how many-th cycle is published")
    listen: tuple[str, ...] = Field((), description="more endpoints: 'tls/0.0.0.0:7447', 'tcp/127.0.0.1:7447'")
    tls: TlsConfig | None = None
    roles: dict[Literal["observer", "operator", "engineer"], tuple[str, ...]] = Field(
        {}, description="who may do what from the network: the common names (CN) of the certificates of each role"
    )

    ros2: Ros2Config | None = Field(None, description="the run as a node of ROS 2; true: with the defaults")

    @field_validator("ros2", mode="before")
    @classmethod
    def _switched(cls, given: Any) -> Any:
        return {} if given is True else None if given is False else given

    @model_validator(mode="after")
    def _reached(self) -> BusConfig:
        if self.ros2 is None:
            return self
        match = _ENDPOINT.match(self.ros2.router)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise ValueError(f"ros2.router: '{self.ros2.router}' must read tcp/HOST:PORT or tls/HOST:PORT")
        if match["protocol"] == "tls" and self.tls is None:
            raise ValueError(f"ros2.router: '{self.ros2.router}' needs `tls:` with ca, certificate and key")
        if match["protocol"] == "tcp" and self.ros2.commands and not _is_loopback(match["host"]):
            raise ValueError(
                f"ros2.router: over '{self.ros2.router}' anyone on the network could move the limb; "
                "use a router on this machine (tcp/127.0.0.1:7447), tls/..., or leave `commands` off"
            )
        return self

    @model_validator(mode="after")
    def _closed(self) -> BusConfig:
        for endpoint in self.listen:
            match = _ENDPOINT.match(endpoint)
            if match is None or not 0 < int(match["port"]) < 65536:
                raise ValueError(f"listen: '{endpoint}' must read tcp/HOST:PORT or tls/HOST:PORT")
            if match["protocol"] == "tcp" and not _is_loopback(match["host"]):
                raise ValueError(
                    f"listen: '{endpoint}' would let anyone on the network move the limb; "
                    f"use tls/{match['host']}:{match['port']} with `tls:`, or 127.0.0.1"
                )
            if match["protocol"] == "tls" and self.tls is None:
                raise ValueError(f"listen: '{endpoint}' needs `tls:` with ca, certificate and key")
            if match["protocol"] == "tls" and not any(self.roles.values()):
                raise ValueError(
                    f"listen: '{endpoint}' needs `roles:`, which says who may do what by the common names of the "
                    "certificates: roles: {operator: [anna], observer: [otto]}"
                )
        seen: dict[str, str] = {}
        for role, names in self.roles.items():
            for name in names:
                if not name.strip() or (other := seen.setdefault(name, role)) != role:
                    has = f"also among the {other}s" if name.strip() else "no name"
                    raise ValueError(f"roles: '{name}' ({role}) is {has}; give each certificate's name one role")
        return self


def warnings(config: BusConfig | None) -> list[str]:
    """What a person should know of who may command the limb."""
    if config is None or config.ros2 is None or not config.ros2.commands or config.ros2.router.startswith("tls/"):
        return []
    return [
        f"bus.ros2.commands: whoever reaches the router at {config.ros2.router} may move the limb. rmw_zenohd listens "
        "on every address of the machine, unless its configuration says listen: tcp/127.0.0.1:7447"
    ]


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False  # a name may resolve to anything, localhost included
