"""Checks the host's CAN interfaces that a profile names: there, up, at the right bit rate, with room to send."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from srl.runtime.service.fitness.finding import Finding, read

NETWORK = Path("/sys/class/net")
_SCHEME = "can://socketcan/"
_ARPHRD_CAN, _IFF_UP = 280, 1
_QUEUE = 100  # frames; the kernel's 10 are fewer than a cycle of some limbs sends


def interfaces(buses: Mapping[str, float]) -> Iterator[Finding]:
    """Each interface; `buses`: the bit rate by the bus's URL, bit/s."""
    for bus, bitrate in sorted(buses.items()):
        if bus.startswith(_SCHEME):
            yield from _interface(bus.removeprefix(_SCHEME).partition("?")[0], round(bitrate))


def _interface(name: str, bitrate: int) -> Iterator[Finding]:
    what, at = f"CAN interface {name}", NETWORK / name
    up = f"sudo ip link set {name} up type can bitrate {bitrate} restart-ms 100"
    again = f"sudo ip link set {name} down && {up}"
    if not at.exists():
        yield Finding(
            what, "bad", f"there is no interface {name}", "Plug the adapter in, load its driver, and bring it up", up
        )
        return
    if not int(read(at / "flags") or "0", 16) & _IFF_UP:
        yield Finding(what, "bad", f"{name} is down", "Bring it up", up)
        return
    if read(at / "type") != str(_ARPHRD_CAN):
        yield Finding(what, "bad", f"{name} is no CAN interface", "Name another one in the profile", "ip -br link")
        return
    about = _about(name)
    found, state = about.get("bittiming", {}).get("bitrate"), str(about.get("state", ""))
    if found is not None and found != bitrate:
        yield Finding(what, "bad", f"{name} has {found} bit/s, the devices {bitrate}", "Set its bit rate", again)
    elif state in ("BUS-OFF", "ERROR-PASSIVE"):
        remedy = "Check the wires, the power and the terminators (120 ohm at both ends), then begin anew"
        yield Finding(what, "bad", f"{name} is {state}: its frames fail", remedy, again)
    else:
        yield Finding(what, "good", f"{name} is up" + f" at {found} bit/s" * (found is not None))
    queue = int(read(at / "tx_queue_len") or 0)
    if 0 < queue < _QUEUE:
        yield Finding(
            f"queue of {name}", "doubtful", f"{queue} frames: a cycle may find it full", "Make it longer",
            f"sudo ip link set {name} txqueuelen 1000",
        )  # fmt: skip


def _about(name: str) -> dict[str, Any]:
    """What iproute2 says of the interface; nothing where it isn't installed."""
    command = ["ip", "-details", "-json", "link", "show", name]
    try:
        output = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=5).stdout)
        found: dict[str, Any] = output[0]["linkinfo"]["info_data"]
    except (OSError, subprocess.SubprocessError, ValueError, LookupError):
        return {}
    return found
