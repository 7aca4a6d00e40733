"""Emergency and reset inputs: which signals may stop the limb, and which may let it go on."""

from __future__ import annotations

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile.builder import Builder


def check(b: Builder, devices: list[Driver]) -> None:
    """Checks both. Raises WiringError."""
    _emergency(b)
    _reset(b, devices)


def _emergency(b: Builder) -> None:
    """An emergency input is read in every state: what a law makes stands still while the limb is stopped."""
    for i, entry in enumerate(b.profile.emergency):
        place = b.source.place(f"emergency.{i}")
        entry.find(b.signals, place)
        if b.layout.fields[entry.signal].role not in ("state", "setpoint"):
            problem = f"'{entry.signal}' is what no device or client says, so nobody could tell whether it still holds"
            raise WiringError(place, problem, "Name a device's state: the switch itself")


def _reset(b: Builder, devices: list[Driver]) -> None:
    """A reset input is a button of a device: what a client or a law writes would release a person's stop."""
    states = {f"{d.name}.{s.name}" for d in devices for s in d.states}
    stops = {(e.signal, e.find(b.signals, "")) for e in b.profile.emergency}
    real = [d.name for d in devices if d.commands and d.name not in b.simulated]
    elsewhere = {d.name: "gives what another machine or a recording says" for d in devices if not d.here}
    if real:
        elsewhere |= {name: f"is simulated, and '{real[0]}' is real" for name in b.simulated}
    for i, entry in enumerate(b.profile.reset.inputs):
        path = f"reset.inputs.{i}"
        if entry.signal in b.signals and entry.signal not in states:
            problem = f"'{entry.signal}' isn't the state of a device, and only a button of a device may reset"
            raise WiringError(b.source.place(path), problem, f"Name one of: {', '.join(sorted(states)) or 'none'}")
        name = entry.find(b.signals, b.source.place(path))
        if (entry.signal, name) in stops:
            problem = f"'{entry.signal}[{name}]' is an emergency input, whose release must not reset"
            raise WiringError(b.source.place(path), problem, "Wire a button of its own")
        if why := elsewhere.get(entry.signal.partition(".")[0]):
            problem = f"'{entry.signal}' is no button that a person presses here: its device {why}"
            raise WiringError(b.source.place(path), problem, "Wire a button of this machine, or remove this input")
