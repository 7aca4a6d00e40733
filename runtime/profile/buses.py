"""What a profile's buses carry: the frames of all devices on a line, at the loop's rate, in the worst case; and whose.

A motor can't tell who sends what it listens to: it takes another device's reply on its own identifier for a command.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from srl.runtime.contracts.driver import EXTENDED, Driver, Traffic
from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile.builder import Builder


def check(b: Builder, devices: Sequence[Driver]) -> list[str]:
    """Returns a line on each bus.

    Raises:
        WiringError: a bus can't carry its devices at the loop's rate, they name different bit rates, or two of them
            use an identifier.
    """
    buses: dict[str, dict[str, Traffic]] = {}
    for device in devices:
        if device.traffic is not None:
            buses.setdefault(device.traffic.bus, {})[device.name] = device.traffic
    for bus, users in buses.items():
        for (one, its), (other, others) in combinations(users.items(), 2):
            _tell_apart(b, bus, {one: its, other: others})
    return [_judge(b, bus, users) for bus, users in buses.items()]


def _tell_apart(b: Builder, bus: str, pair: dict[str, Traffic]) -> None:
    """Refuses two devices of which one would obey, or take for its own, what belongs to the other."""
    (one, its), (other, others) = pair.items()
    both = its.identifiers.keys() & others.identifiers.keys() - (its.common & others.common)
    if not both:
        return
    first = min(both)
    also = f" (and {len(both) - 1} more)" if len(both) > 1 else ""
    extended = "extended " if first & EXTENDED else ""
    raise WiringError(
        b.source.place(f"devices.{other}"),
        f"'{one}' and '{other}' are on {bus}, and both use the {extended}identifier {first & ~EXTENDED:#x}{also}: "
        f"{its.identifiers[first]} of '{one}', {others.identifiers[first]} of '{other}'. One would obey the other's "
        "frames",
        "Give one of them another id with the maker's tool and in the profile, or put it on another bus",
    )


def _judge(b: Builder, bus: str, users: dict[str, Traffic]) -> str:
    rate, names = float(b.profile.rate), " and ".join(users)
    rates = {t.bitrate for t in users.values()}
    if len(rates) > 1:
        rates_text = ", ".join(f"{name} {t.bitrate:g} bit/s" for name, t in users.items())
        problem = f"the devices on {bus} have different bit rates: {rates_text}"
        raise WiringError(b.source.place("devices"), problem, "One bus has one: correct them")
    (bitrate,) = rates
    each, other = sum(t.per_cycle for t in users.values()), sum(t.per_second for t in users.values())
    most = int((bitrate - other) / each) if each else 0
    load = (each * rate + other) / bitrate
    if load > 1.0:
        remedy = "Use a second bus"
        if most >= 1:
            remedy = f"Set 'rate' to {most} or less, or put some of the devices on a second bus"
        raise WiringError(
            b.source.place("rate"),
            f"{bus} can't carry {names} at {rate:g} Hz: their frames take up to {100 * load:.0f} % of its "
            f"{bitrate / 1e6:g} Mbit/s",
            remedy,
        )
    ceiling = f", {most} Hz at most" if each else ""
    return f"{bus}: {names} take up to {100 * load:.0f} % of {bitrate / 1e6:g} Mbit/s at {rate:g} Hz{ceiling}"
