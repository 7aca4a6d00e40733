"""What `srl new` says of the ports that a profile names: on this machine, now."""

from __future__ import annotations

import os
from collections.abc import Iterator

from srl.commissioning.cli.find_port import likely
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.ports import local_path
from srl.runtime.service import serial_ports


def remarks(graph: Graph) -> Iterator[str]:
    """A line for each thing that may be wrong with a device's port. Opens none."""
    there = {os.path.realpath(port.device): port for port in serial_ports.ports()}
    for device in graph.devices:
        given = getattr(device.config, "port", None)
        path = local_path(given) if isinstance(given, str) else None
        if path is None:
            continue
        if (lack := serial_ports.obstacle(path)) is not None:
            yield f"not yet: port of {device.name}: {lack.problem}. {lack.remedy}"
            continue
        if (holder := serial_ports.holder(path)) is not None:
            yield f"port of {device.name}: {holder} has it open"
        port = there.get(os.path.realpath(path))
        if port is None:
            continue
        if path == port.device != port.path:
            yield f"port of {device.name}: another order of plugging in changes {path}; {port.path} stays"
        driver = graph.profile.devices[device.name].driver
        if port.guesses and driver not in [guess.driver for guess in port.guesses]:
            yield f"port of {device.name}: {likely(port)}. Is it {driver}'s?"
