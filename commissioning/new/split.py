"""A profile on two computers: one has some of its devices, and the other reads these over the bus."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

from srl.commissioning.new.template import check_name
from srl.runtime import __version__
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import ProfileError, RequestError, SrlError, nearest
from srl.runtime.contracts.files import Files
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.edit import edited, set_at
from srl.runtime.profile.keys import Keys
from srl.runtime.profile.part import frames_left
from srl.runtime.profile.source import Source

PORT: Final = 7447
_CERTIFICATES: Final = "/etc/srl"
_KEPT: Final = ("models", "meant")


@dataclass(frozen=True)
class Halves:
    """Both profiles.

    Attributes:
        near, far: the names, of the one with the devices and of the one that reads them.
        texts: YAML by name.
        folder: where the profile was that they are made of: paths in it begin there.
    """

    near: str
    far: str
    texts: dict[str, str]
    folder: Path


def split(whole: str, name: str, devices: Sequence[str], host: str | None, overrides: Sequence[str] = ()) -> Halves:
    """Makes both halves.

    Args:
        whole: the profile's name or file.
        name: of the half with the devices.
        devices: those on the other computer. They only measure.
        host: the name or address of that computer; None: both run on this one.
        overrides: as for `srl run`, with `--set`.
    Raises:
        RequestError: there is no such device, it takes commands, or nothing else is left.
        SrlError: the profile is wrong.
    """
    check_name(name)
    label, text, folder = profile.find(whole)
    checked, source = profile.parse(label, text, overrides, Files(folder))
    graph = wiring.build(checked, source)
    found = {device.name: device for device in graph.devices}
    for device in devices:
        if device not in found:
            raise RequestError(f"--split {device}", f"{label} has no device '{device}'", nearest(device, found))
        if found[device].commands:
            problem = f"'{device}' takes commands, and these must not cross a network"
            raise RequestError(f"--split {device}", problem, "Name devices that only measure")
    far = f"{checked.name}-with-{name}"
    moved = [found[device] for device in devices]
    texts = {name: _near(checked, source, name, far, devices, host)}
    texts[far] = _far(text, label, name, far, moved, host, overrides)
    for each, made in texts.items():
        _check(f"{each}.yaml", made, folder)
    return Halves(name, far, texts, folder)


def _near(
    checked: profile.Profile, source: Source, name: str, far: str, devices: Sequence[str], host: str | None
) -> str:
    """The half with the devices: no law, no limb, and every cycle on the bus."""
    whole, _ = profile.tree(source.label, source.text, source.overrides, source.files)
    plain: dict[str, Any] = {"name": name, "summary": f"{', '.join(devices)}, for {far}", "rate": whole["rate"]}
    plain["devices"] = {device: whole["devices"][device] for device in devices}
    plain["controllers"] = []
    plain |= {key: whole[key] for key in _KEPT if key in whole}
    if frames := frames_left(checked, whole.get("frames") or {}, set(devices), [], sim=False):
        plain["frames"] = frames
    plain["bus"] = {"decimate": 1}
    if host is not None:
        plain["bus"] |= {"listen": [f"tls/0.0.0.0:{PORT}"], "tls": _tls(name), "roles": {"observer": [far]}}
    head = f"# Of {source.label}, by srl {__version__}: for the computer that has {', '.join(devices)}.\n"
    if whole.get("sim"):
        sim = {key: value for key, value in whole["sim"].items() if key not in ("ends_with", "duration", "devices")}
        sim["devices"] = {d: v for d, v in (whole["sim"].get("devices") or {}).items() if d in devices}
        with contextlib.suppress(SrlError):  # a world that needs what is left out
            simulated = head + _yaml(plain | {"sim": sim})
            wiring.build(*profile.parse(source.label, simulated, (), source.files), [])
            return simulated
    return head + _yaml(plain)


def _far(
    text: str, label: str, name: str, far: str, moved: Sequence[Driver], host: str | None, overrides: Sequence[str]
) -> str:
    """The half with the limb: each device is read over the bus, with the same signals."""
    made = edited(label, text, overrides)
    plain, _ = profile.tree(label, made)
    for device in moved:
        entry: dict[str, Any] = {"driver": "zenoh", "port": f"unixsock-stream/{RunFolder.of(name).bus_socket}"}
        if host is not None:
            entry |= {"port": f"tls://{host}:{PORT}", "tls": _tls(far)}
        entry["signals"] = {}
        for signal in device.states:
            one: dict[str, Any] = {"key": Keys(name).state(f"{device.name}.{signal.name}"), "shape": list(signal.shape)}
            one |= {"unit": signal.unit}
            one |= {"frame": signal.frame} if signal.frame else {}
            one |= {"labels": list(signal.labels)} if signal.labels else {}
            one |= {"slots": True} if signal.slots else {}
            one |= {"components": [list(names) for names in signal.components]} if signal.components else {}
            entry["signals"][signal.name] = one
        made = set_at(made, f"devices.{device.name}", entry)
        if device.name in ((plain.get("sim") or {}).get("devices") or {}):
            made = set_at(made, f"sim.devices.{device.name}", {})  # what its own simulation took says nothing here
    made = set_at(made, "name", far)
    return (
        f"# Of {label}, by srl {__version__}: {', '.join(d.name for d in moved)} on another computer ({name}).\n{made}"
    )


def _yaml(plain: dict[str, Any]) -> str:
    stream = io.StringIO()
    YAML().dump(json.loads(json.dumps(plain)), stream)
    return stream.getvalue()


def _tls(name: str) -> dict[str, str]:
    own = f"{_CERTIFICATES}/{name}"
    return {"ca": f"{_CERTIFICATES}/ca.pem", "certificate": f"{own}.pem", "key": f"{own}.key"}


def _check(label: str, text: str, folder: Path) -> None:
    """Raises RequestError: this half isn't a whole profile; certificates are looked for where it runs."""
    try:
        wiring.build(*profile.parse(label, text, (), Files(folder)))
    except ProfileError as error:
        problem = f"{error.place} would be wrong: {error.problem}"
        raise RequestError(
            "--split", problem, "Split other devices, or write that half by hand (docs/devices)"
        ) from None
    except SrlError as error:
        raise RequestError("--split", f"{error.place}: {error.problem}", error.remedy) from None
