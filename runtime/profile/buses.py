"""What a profile's buses carry: the frames of all devices on a line, at the loop's rate, in the worst case."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.contracts.driver import Driver, Traffic
from runtime.contracts.errors import WiringError
from runtime.profile.builder import Builder


def check(b: Builder, devices: Sequence[Driver]) -> list[str]:
    """Returns a line on each bus.

    Raises:
        WiringError: a bus can't carry its devices at the loop's rate, or they name different bit rates.
    """
    buses: dict[str, dict[str, Traffic]] = {}
    for device in devices:
        if device.traffic is not None:
            buses.setdefault(device.traffic.bus, {})[device.name] = device.traffic
    return [_judge(b, bus, users) for bus, users in buses.items()]


def _judge(b: Builder, bus: str, users: dict[str, Traffic]) -> str:
    rate, names = float(b.profile.rate), " and ".join(users)
    rates = {t.bitrate for t in users.values()}
    if len(rates) > 1:
        said = ", ".join(f"{name} {t.bitrate:g} bit/s" for name, t in users.items())
        problem = f"the devices on {bus} have different bit rates: {said}"
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
