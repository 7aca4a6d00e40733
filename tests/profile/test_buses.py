"""What the devices on a shared line take of it is added up before anything is opened."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.toy import PROFILE, Law, Toy, ToyConfig

from srl.drivers.canbus import frame_bits
from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Traffic
from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile import buses, profile, wiring
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.graph import Graph

SEVEN = 7 * 2 * frame_bits(8)  # seven motors: a command and a reply each


def build(monkeypatch: pytest.MonkeyPatch, rate: int, **traffic: Traffic) -> Graph:
    class Device(Toy):
        def __init__(self, name: str, config: ToyConfig) -> None:
            super().__init__(name, config)
            self.traffic = traffic.get(name)

    monkeypatch.setattr(registry, "load", lambda group, name, place: {"drivers": Device, "controllers": Law}[group])
    text = PROFILE.format(arm="arm", speed=1.0, emergency="", more="")
    return wiring.build(*profile.parse("toy.yaml", text, [f"rate={rate}"]))


@pytest.mark.parametrize(("size", "extended", "bits"), [(8, False, 135), (8, True, 160), (0, False, 55)])
def test_a_frame_s_bits_are_those_of_the_worst_case(size: int, extended: bool, bits: int) -> None:
    assert frame_bits(size, extended) == bits


def test_seven_motors_fit_at_500_hz(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = build(monkeypatch, 500, arm=Traffic("can://socketcan/can0", 1e6, SEVEN))
    assert "can://socketcan/can0: arm take up to 94 % of 1 Mbit/s at 500 Hz, 529 Hz at most" in graph.remarks


@pytest.mark.parametrize(
    ("traffic", "output"),
    [
        ({"arm": Traffic("a", 1e6, SEVEN)}, "can't carry arm at 1000 Hz.*189 %.*Set 'rate' to 529 or less"),
        (
            {"arm": Traffic("a", 1e6, 600), "hand": Traffic("a", 1e6, 0, 540_000)},
            "can't carry hand and arm at 1000 Hz.*114 %.*Set 'rate' to 766 or less",
        ),
        ({"arm": Traffic("a", 1e6, 0, 2e6)}, "Use a second bus"),
        ({"arm": Traffic("a", 1e6, 9), "hand": Traffic("a", 5e5, 9)}, "different bit rates"),
        (
            {"arm": Traffic("a", 1e6, 9, 0, {7: "a command"}), "hand": Traffic("a", 1e6, 9, 0, {7: "a reply"})},
            "'hand' and 'arm' are on a, and both use the identifier 0x7: a reply of 'hand', a command of 'arm'",
        ),
    ],
)
def test_a_bus_that_is_asked_for_more_is_refused(
    monkeypatch: pytest.MonkeyPatch, traffic: dict[str, Any], output: str
) -> None:
    with pytest.raises(WiringError, match=output):
        build(monkeypatch, 1000, **traffic)


def test_what_is_on_two_buses_is_counted_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = build(monkeypatch, 1000, arm=Traffic("a", 1e6, 600), hand=Traffic("b", 1e6, 600))
    assert len([line for line in graph.remarks if "60 %" in line]) == 2


DAMIAO = (
    "{driver: mit-can, port: PORT, maker: damiao, "
    "motors: {j: {id: 1, model: DM4340, lower: -1, upper: 1, kp: 9, kd: 1}}}"
)
AK = (
    "{driver: mit-can, port: PORT, maker: cubemars, firmware: v2, enable_at_open: true, "
    "motors: {k: {id: ID, model: AK80-9, lower: 0, upper: 1, park: 0, kp: 9, kd: 1}}}"
)
SERVO = (
    "{driver: cubemars-servo, port: PORT, timeout: 0.5, axes: {s: {id: ID, model: AK80-9, parked: 0, lower: 0, "
    "upper: 1, velocity: 1, acceleration: 9, current: 9, torque_constant: 1}}}"
)
ODRIVE = (
    "{driver: odrive, port: PORT, bitrate: 1000000, firmware: '0.5', watchdog_set: true, axes: {o: {node: ID, "
    "parked: 0, velocity: 1, current: 9, torque_constant: 0.1}}}"
)
FT = "{driver: can-ft, port: PORT, ids: [ID, 0x66, 0x67]}"


def two(one: str, other: str, ports: tuple[str, str] = ("can://socketcan/can0",) * 2) -> list[str]:
    """The buses of a profile with two real devices, the ids given."""
    entries = [text.replace("PORT", port) for text, port in zip((one, other), ports, strict=True)]
    text = f"name: two\nrate: 100\nstart: manual\ndevices:\n  left: {entries[0]}\n  right: {entries[1]}\n"
    b = Builder(*profile.parse("two.yaml", text), None)
    drivers = (registry.load("drivers", entry.driver, name) for name, entry in b.profile.devices.items())
    made = [
        driver(name, b.options(driver.Config, entry.options, f"devices.{name}"))
        for driver, (name, entry) in zip(drivers, b.profile.devices.items(), strict=True)
    ]
    return buses.check(b, made)


@pytest.mark.parametrize(
    ("one", "other", "output"),
    [
        (
            DAMIAO,
            AK.replace("ID", "0x11"),
            r"line 6: devices.right: 'left' and 'right' are on can://socketcan/can0, and both use the identifier 0x11: "
            "replies of 'j' of 'left', commands for 'k' and its replies of 'right'.*another id",
        ),
        (DAMIAO, DAMIAO, "identifier 0x1 "),
        (DAMIAO, AK.replace("ID", "1"), "identifier 0x1:"),
        (DAMIAO, ODRIVE.replace("ID", "0"), r"identifier 0x1 \(and 1 more\)"),
        (DAMIAO, ODRIVE.replace("ID", "8"), "identifier 0x101: commands of other modes for 'j'"),
        (AK.replace("ID", "40"), ODRIVE.replace("ID", "1"), "identifier 0x28:.*node 1"),
        (AK.replace("ID", "40"), ODRIVE.replace("ID", "0"), "identifier 0x0: replies of its motors"),
        (ODRIVE.replace("ID", "3"), ODRIVE.replace("ID", "3"), "identifier 0x60 .and 31 more"),
        (SERVO.replace("ID", "7"), SERVO.replace("ID", "7"), "extended identifier 0x7 "),
        (
            SERVO.replace("ID", "7"),
            AK.replace("ID", "7").replace("v2", "v3"),
            "extended identifier 0x7 .*commands for 's'.*commands for 'k'",
        ),
        (FT.replace("ID", "0x65"), AK.replace("ID", "0x66"), "identifier 0x66: first halves of records"),
    ],
)
def test_devices_of_one_bus_that_would_obey_each_other_are_refused(one: str, other: str, output: str) -> None:
    with pytest.raises(WiringError, match=output):
        two(one, other)
    two(one, other, ("can://socketcan/can0", "can://socketcan/can1"))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (DAMIAO, DAMIAO.replace("id: 1", "id: 2")),  # both are asked on 0x7FF
        (AK.replace("ID", "4"), AK.replace("ID", "5")),  # both may reply on 0
        (SERVO.replace("ID", "1"), DAMIAO),  # 29 bits, and 11
        (ODRIVE.replace("ID", "4"), DAMIAO),
        (FT.replace("ID", "0x65"), DAMIAO),
    ],
)
def test_devices_of_one_bus_that_can_be_told_apart_are_taken(one: str, other: str) -> None:
    assert len(two(one, other)) == 1


def test_options_of_an_adapter_make_no_other_bus() -> None:
    ports = ("can://slcan//dev/ttyACM0?bitrate=1000000", "can://slcan//dev/ttyACM0")
    with pytest.raises(WiringError, match="identifier 0x1"):
        two(DAMIAO, AK.replace("ID", "1"), ports)
    group = "can://udp_multicast/239.74.163.2?hop_limit=0&port="
    two(DAMIAO, AK.replace("ID", "1"), (group + "43111", group + "43112"))
