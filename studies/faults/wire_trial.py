"""One trial: an unchanged driver in front of its twin, over the device's own wire, and a wire that fails.

The world's time passes only between two reads. The bytes go through the kernel, so a trial may last a few cycles more
or less than the same one did before.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from random import Random
from typing import Any, Final

import numpy as np

from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, SrlError
from srl.runtime.contracts.world import Twin
from srl.runtime.testing.bound import bound
from srl.runtime.testing.twin_bench import TwinBench
from srl.sim.devices.examples import DEVICES
from srl.studies.faults.device_faults import SLACK
from srl.studies.tasks.task import Value

DEVICE: Final = "device"
CYCLE: Final = 0.01  # s of the world between two reads
WARM: Final = (0.2, 0.8)  # s
LASTS: Final = 0.5  # s for which a fault goes on after what is expected of it
SOON: Final = 3.0  # s in which a cut link must be known
KINDS: Final = {
    "hang": "over the wire: the peer says nothing, its port or connection stays open (half-open TCP)",
    "cut": "over the wire: the port or connection is gone",
    "noise": "over the wire: random bytes from the peer's port",
    "foreign": "over the wire: frames of other devices from the peer's port",
    "other-device": "over the wire: another device is at the port at the start",
}
# A process behind the link has a clock of its own; a gamepad and a ring tell only what changes, in the kernel's words.
OTHERS: Final = ("cyberglove", "firmata", "dynamixel")  # those that are at the port instead
NOT: Final = ("base", "lsl", "zenoh", "gamepad", "ring", "replay")
# Frames as on the wires of others: a CyberGlove's record, a Dynamixel's status, a Firmata report, an RTDE header, text.
FOREIGN: Final = (
    b"G" + bytes(range(1, 23)) + b"\0", b"\xff\xff\xfd\x00\x01\x08\x00\x55\x00\xa6\x00\x00\x00\x8c\xc0",
    b"\xf0\x79\x02\x05\xf7\xe0\x01\x01", b"\x00\x0b\x55\x01\x00\x00\x00\x00\x00\x00\x00", b"$GPGGA,1,2,3*55\r\n",
    bytes(36), b"\xff" * 64,
)  # fmt: skip


def kinds_of(kind: str) -> list[str]:
    """The faults that this device's wire can have."""
    address = DEVICES[kind][3]
    serial = kind in ("bno085", "cyberglove", "dynamixel", "feetech", "firmata", "softhand")
    found = ["hang", "cut"]
    if serial:
        found += ["noise", "foreign", "other-device"]
    elif address.startswith("udp"):
        found += ["noise", "foreign"]
    return found


def _twin(kind: str) -> Twin:
    """Its twin in a world of its own, as `srl.sim.devices.examples` has it."""
    config, options, cell, port = DEVICES[kind]
    place, parts = f"device '{kind}'", dict(cell)
    worlds = registry.load("worlds", parts.pop("world"), place)
    fakes, twins = (registry.load(group, kind, place) for group in ("fakes", "twins"))
    world = worlds(worlds.Config.model_validate(parts), 1)
    given = ({"port": port} if "port" in fakes.Config.model_fields else {}) | config
    fake = bound(fakes(DEVICE, fakes.Config.model_validate(given), world, fakes.Options.model_validate(options)))
    made: Twin = twins(fake)
    return made


def trial(profile: str, parameters: Mapping[str, Any], seed: int) -> dict[str, Value]:
    """Runs one trial; parameters: `kind` of the device, `fault`, `other` for another device at the port."""
    kind, fault = parameters["kind"], parameters["fault"]
    there = parameters["other"] if fault == "other-device" else kind
    bench = TwinBench.of(_twin(there))
    with bench:
        driver = _driver(kind, bench.address)
        try:
            if fault == "other-device":
                return _other(bench, driver)
            with bench.serving():
                driver.open()
            return _break(bench, driver, fault, Random(seed))
        finally:
            driver.close()


def _driver(kind: str, port: str) -> Driver:
    config = DEVICES[kind][0]
    cls = registry.load("drivers", kind, f"device '{kind}'")
    made: Driver = bound(cls(DEVICE, cls.Config.model_validate({"port": port} | config)))
    return made


def _other(bench: TwinBench, driver: Driver) -> dict[str, Value]:
    """Another device's twin is at the port: it must be refused, or give no sample."""
    try:
        with bench.serving():
            driver.open()
    except DeviceError as error:
        why = str(error)
        return _row("refused", why[:200], None, None, "" if len(why) > len(DEVICE) + 4 else "it doesn't say why")
    before = driver.health.stamp
    lost = _read(bench, driver, 2.0)
    taken = driver.health.stamp > max(before, 0)
    wrong = "samples of another device are taken" if driver.states and taken else ""
    return _row("device_loss" if lost is not None else "stale", "", None, None, wrong)


def _break(bench: TwinBench, driver: Driver, fault: str, chance: Random) -> dict[str, Value]:
    if (lost := _read(bench, driver, chance.uniform(*WARM))) is not None:
        raise SrlError(DEVICE, "it was lost before the fault", "Look at the twin")
    age = driver.max_age
    due = SOON if fault == "cut" else age + SLACK * CYCLE
    if fault == "cut":
        bench.twin.close()
    elif fault == "hang":
        bench.twin.muted = True  # type: ignore[attr-defined]
    bad = _bad(driver)
    started, wrong = bench.now, list[str]()
    safe: float | None = None
    speak = _speaker(bench, driver, fault, chance)
    while bench.now - started < (due + LASTS) * 1e9:
        speak()
        if _read(bench, driver, CYCLE) is not None:
            lost = safe = (bench.now - started) * 1e-9 if safe is None else safe
            break
        if driver.states and age > 0 and bench.now - driver.health.stamp > age * 1e9 and safe is None:
            safe = (bench.now - started) * 1e-9
        if any(np.isinf(values).any() for values in driver.state_arrays.values()):  # NaN says that nothing is known
            wrong.append("a value is infinite")
            break
    if fault == "cut" and lost is None:
        wrong.append("the port is gone, and it goes on")
    if fault == "hang" and driver.states and age > 0 and (safe is None or safe > due):
        wrong.append(f"its sample is stale {'never' if safe is None else f'after {safe:.2f} s'}, {due:.2f} s is due")
    if hasattr(bench.twin, "door") and fault in ("noise", "foreign") and lost is None and not _bad(driver) - bad:
        wrong.append("what came is counted nowhere")
    entered = "device_loss" if lost is not None else "stale" if safe is not None else "goes on"
    return _row(entered, "", safe, due if fault in ("cut", "hang") else None, "; ".join(wrong))


def _speaker(bench: TwinBench, driver: Driver, fault: str, chance: Random) -> Callable[[], None]:
    """What comes over the wire in each cycle of a fault, besides what the peer itself says."""
    if fault not in ("noise", "foreign"):
        return lambda: None
    bench.twin.muted = True  # type: ignore[attr-defined]

    def data() -> bytes:
        if fault == "noise":
            return chance.randbytes(chance.randrange(1, 200))
        return b"".join(chance.choice(FOREIGN) for _ in range(3))

    door = getattr(bench.twin, "door", None)
    if door is not None:
        return lambda: door.write(data())
    port = int(bench.address.partition("?")[0].rpartition(":")[2])
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # from somebody else on the network

    def send() -> None:
        sender.sendto(data(), ("127.0.0.1", port))

    return send


def _read(bench: TwinBench, driver: Driver, seconds: float) -> float | None:
    """Reads for so long; when it said that it was lost, s; None: it didn't. Any other exception is the trial's."""
    started = bench.now
    while bench.now - started < seconds * 1e9:
        bench.run(CYCLE)
        try:
            driver.read(bench.now)
        except DeviceLostError:
            return (bench.now - started) * 1e-9
    return None


def _bad(driver: Driver) -> int:
    """What it couldn't take for a frame so far."""
    return driver.health.errors + driver.health.resyncs


def _row(entered: str, cause: str, safe: float | None, due: float | None, wrong: str) -> dict[str, Value]:
    return {
        "entered": entered, "cause": cause, "fault_source": DEVICE, "safe": safe, "due": due, "step": 0.0, "where": "",
        "recorded": True, "cycles": 0, "wrong": wrong,
    }  # fmt: skip
