"""What a wiring does with names: values that tell where they come from, and parts of somebody else's."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.signals import Array, Command, Kind, Signal, Stop
from srl.runtime.ipc.row import Row
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph


def build(text: str, sim: list[str] | None = None) -> Graph:
    return wiring.build(*profile.parse("profile.yaml", text), sim)


def read(graph: Graph, law: int, port: str) -> dict[str, Array]:
    """What a port of a controller reads, by its own names, from the row as it is."""
    wired = graph.laws[law]
    for index, array in wired.reads:
        graph.row.floats.take(index, 0, array, "clip")
    return dict(zip(wired.inputs[port].near.names, wired.controller.input[port].copy(), strict=True))


def write(graph: Graph, law: int, **outputs: dict[str, float]) -> None:
    """Lets a controller give these values, by its own names, and puts them into the row."""
    wired = graph.laws[law]
    for name, values in outputs.items():
        labels = wired.outputs[name].near.names
        wired.controller.output[name][:] = [values[label] for label in labels]
    for index, array in wired.writes:
        graph.row.floats[index] = array


def named(row: Row, signal: str) -> dict[str, float]:
    """The present values of a signal, by name."""
    return dict(zip(row.layout.fields[signal].labels, row.views[signal].tolist(), strict=True))


class Device(Driver):
    """Devices of somebody else: what each declares is given by its name in `declared`."""

    declared: ClassVar[dict[str, tuple[tuple[Signal, ...], tuple[Command, ...]]]] = {}
    max_age = 0.1

    def __init__(self, name: str, config: DeviceConfig) -> None:
        super().__init__(name, config)
        self.states, self.commands = self.declared[name]
        self.home = {c.name: (np.arange(c.size) / 10).reshape(c.shape) for c in self.commands}

    def open(self) -> None: ...

    def read(self, now: int) -> None: ...

    def write(self, now: int) -> None: ...

    def stop(self, category: Stop) -> None: ...

    def close(self) -> None: ...


class Law(Controller):
    """A law of somebody else, by its name in `declared`."""

    declared: ClassVar[dict[str, tuple[tuple[Signal, ...], tuple[Signal, ...]]]] = {}

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.inputs, self.outputs = self.declared[name]

    def reset(self) -> None: ...

    def update(self, dt: float) -> None: ...


def joints(name: str, *labels: str, **rest: Any) -> Signal:
    return Signal(name=name, shape=(len(labels),), unit="rad", labels=labels, **rest)


def command(name: str, *labels: str, **rest: Any) -> Command:
    rest = {"period": 0.02, "unit": "rad", "kind": Kind.POSITION, "labels": labels, "shape": (len(labels),)} | rest
    return Command(name=name, **rest)


def foreign(
    monkeypatch: pytest.MonkeyPatch,
    devices: dict[str, tuple[tuple[Signal, ...], tuple[Command, ...]]],
    laws: dict[str, tuple[tuple[Signal, ...], tuple[Signal, ...]]],
    wires: str,
    more: str = "",
) -> Graph:
    """Wires these devices and laws; `wires` are the `in:` and `out:` of each law, a line a law."""
    monkeypatch.setattr(Device, "declared", devices)
    monkeypatch.setattr(Law, "declared", laws)
    monkeypatch.setattr(registry, "load", lambda group, *_: {"drivers": Device, "controllers": Law}[group])
    lines = "".join(
        f"\n  - {{use: law, name: {name}, {wire.strip()}}}"
        for name, wire in zip(laws, wires.strip().splitlines(), strict=True)
    )
    own = "".join(f"\n  {name}: {{driver: foreign}}" for name in devices)
    return build(f"name: foreign\nrate: 100\nbus: null\ndevices:{own}\ncontrollers:{lines}\n{more}\n")
