"""The bus's key expressions: `srl/<instance>/...` in slugs `[a-z0-9_]` (a `-` is illegal in ROS 2)."""

from __future__ import annotations

import re
from collections.abc import Iterable

from srl.runtime.contracts.errors import ProfileError

COMMANDS = ("start", "stop", "reset")
ROLES = ("observer", "operator", "engineer")  # of clients from the network; each may do what those before it may


def slug(name: str) -> str:
    """A name as a slug: "sixth-finger" -> "sixth_finger"."""
    return re.sub(r"[^a-z0-9_]", "_", name.lower())


def path(name: str) -> str:
    """A dotted name as a key: "finger.position_command" -> "finger/position_command"."""
    return "/".join(slug(part) for part in name.split("."))


class Keys:
    """The keys of one instance.

    Each role asks under keys of its own, as zenoh shows the service no certificate: its access control lets a
    certificate of a role ask there only.

    Attributes:
        instance: its name.
        role: the role, one of ROLES, whose requests these keys are; None: a client on this machine.
        reads_only: whether the role may ask for nothing.
        root: what is read.
        asked: what is asked.
    """

    def __init__(self, instance: str, role: str | None = None) -> None:
        self.instance, self.role = instance, role
        self.reads_only = role == "observer"
        self.root = f"srl/{slug(instance)}"
        self.asked = self.root if role is None else f"{self.root}/as/{role}"
        self.status = f"{self.root}/status"
        self.events = f"{self.root}/events"
        self.alive = f"{self.root}/alive"
        self.states = f"{self.root}/state/**"
        self.commands = f"{self.asked}/cmd/**"
        self.parameters = f"{self.asked}/param/**"
        self.setpoints = f"{self.asked}/setpoint/**"
        self.whoami = f"{self.asked}/whoami"

    def state(self, signal: str) -> str:
        """The key of a signal of the row, e.g. "glove.position"."""
        return f"{self.root}/state/{path(signal)}"

    def meta(self, signal: str) -> str:
        """The key of a signal's description."""
        return f"{self.state(signal)}/meta"

    def command(self, name: str) -> str:
        """The key of a command in COMMANDS."""
        return f"{self.asked}/cmd/{name}"

    def parameter(self, name: str) -> str:
        """The key of a parameter, e.g. "mapping.drift_pull"."""
        return f"{self.asked}/param/{path(name)}"

    def setpoint(self, name: str) -> str:
        """The key of a setpoint, e.g. "client.force"."""
        return f"{self.asked}/setpoint/{path(name)}"


def check(names: Iterable[str], what: str) -> None:
    """Raises ProfileError if two names have the same key, or if a name's key is that of another's metadata."""
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(path(name), name)
        if other != name:
            raise ProfileError(
                f"{what} '{name}'",
                f"on the bus it has the same key as '{other}': {path(name)}",
                "Rename one, as only a-z, 0-9 and _ tell keys apart",
            )
    for key, name in seen.items():
        if key.endswith("/meta") and key.removesuffix("/meta") in seen:
            other = seen[key.removesuffix("/meta")]
            raise ProfileError(f"{what} '{name}'", f"its key is that of the metadata of '{other}'", "Rename it")
