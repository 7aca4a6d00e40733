"""The ODrive driver before the first command: what a profile may say, and what opening refuses."""

import dataclasses

import numpy as np
import pytest
from helpers.can_drives import ENDPOINTS, FakeRig, TwinRig, cell, fault, floating, odrive, of
from pydantic import ValidationError

from srl.drivers.odrive import protocol
from srl.drivers.odrive.config import OdriveAxis
from srl.drivers.odrive.units import Scale
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.files import KeptFile

# -- the profile


@pytest.mark.parametrize(
    ("options", "axis", "words"),
    [
        ({"firmware": "0.5", "watchdog_set": False}, {}, "odrivetool set axisN.config.watchdog_timeout = 0.5"),
        ({"firmware": "0.5"}, {"serial": "3564001A2B3C"}, "doesn't tell its serial number"),
        ({"firmware": "0.6", "endpoints": None}, {}, "needs 'endpoints', to arm the watchdog"),
        ({"firmware": "0.6", "watchdog_set": True}, {}, "the driver arms the watchdog itself"),
        ({}, {"parked": None}, "needs 'parked'"),
        ({}, {"zero": 0.1}, "with `encoder: motor` give 'parked'"),
        ({}, {"encoder": "axis", "parked": None}, "less than a turn apart"),
        ({}, {"encoder": "axis", "lower": -1, "upper": 1}, "give 'zero'"),
        ({}, {"serial": "35"}, "twelve hexadecimal digits"),
        ({}, {"node": 3}, "id 3 is used twice"),
        ({}, {"node": 63}, "less than or equal to 62"),
        ({"mode": "torque"}, {"damping": None}, "needs 'damping'"),
        ({"endpoints": KeptFile(ENDPOINTS.path, b"{}")}, {}, "isn't a flat_endpoints.json"),
        (
            {"endpoints": KeptFile(ENDPOINTS.path, ENDPOINTS.content.replace(b'"float"', b'"uint8"'))},
            {},
            "watchdog_timeout isn't a float",
        ),
    ],
)
def test_a_profile_that_can_t_be_is_refused(options, axis, words):
    with pytest.raises(ValidationError, match=words):
        odrive(axis=axis, **options)


@pytest.mark.parametrize("encoder", ["motor", "axis"])
@pytest.mark.parametrize("reversed_", [False, True])
def test_units_come_back(encoder, reversed_):
    given = {"node": 1, "gear": 8, "velocity": 5, "current": 20, "torque_constant": 0.08, "reversed": reversed_}
    given |= {"parked": 0.4} if encoder == "motor" else {"encoder": "axis", "zero": 0.3, "lower": -2.0, "upper": 2.0}
    scale = Scale(OdriveAxis.model_validate(given))
    for value in (-1.3, 0.0, 0.7):
        assert scale.position(scale.turns(value)) == pytest.approx(value)
        assert scale.velocity(scale.turns_velocity(value)) == pytest.approx(value)
        assert scale.torque(scale.motor_torque(value)) == pytest.approx(value)
    sign = -1 if reversed_ else 1
    if encoder == "motor":
        assert scale.position(0.0) == 0.4
        assert scale.position(8.0) == pytest.approx(0.4 + sign * 2 * np.pi)  # one turn of the axis
    else:
        assert scale.position(0.3 / (2 * np.pi)) == pytest.approx(0.0)
        for turn in (-3, 1, 2):  # an absolute encoder may begin in any turn
            scale.fold(turn + 0.1)
            assert scale.position(turn + 0.1) == pytest.approx(sign * (0.2 * np.pi - 0.3))


def test_the_profile_s_limits_are_known_before_the_drives_answer():
    fake = FakeRig(odrive(mode="torque")).fake
    limits = fake.limits["torque_command"]
    assert limits.effort == pytest.approx([30 * 0.083 * 8] * 2)
    assert limits.velocity == pytest.approx([6.0] * 2)
    assert dataclasses.is_dataclass(limits)


# -- opening


def test_opening_moves_nothing_and_arms_the_watchdog():
    config = odrive(watchdog=0.3)
    with TwinRig(config, floating(config), opened=False) as rig:
        rig.open()
        assert not any(rig.twin.metrics()["torque"])
        assert [(node.armed, node.watchdog) for node in rig.twin.nodes] == [(True, pytest.approx(0.3))] * 2
        assert rig.driver.health.message == "firmware 0.6.10; watchdog 0.3 s"
        asked = {protocol.split(m.arbitration_id)[1] for m in rig.heard() if not m.is_remote_frame and m.data}
        assert not asked & {0x07, 0x0C, 0x0D, 0x0E, 0x16, 0x18, 0x19}, "nothing that moves or reboots"


def open_with(change, match, config=None, **options):
    config = config or odrive()
    with TwinRig(config, floating(config), opened=False, **options) as rig:
        change(rig)
        with pytest.raises(DeviceError, match=match) as caught:
            rig.open()
        assert caught.value.remedy
        assert not any(rig.twin.metrics()["torque"])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda rig: setattr(rig.twin, "muted", True), "no ODrive is heard"),
        (lambda rig: setattr(of(rig), "mute", True), "'hip' .node 1. isn't heard; heard are nodes 2"),
        (lambda rig: setattr(of(rig), "firmware", (0, 6, 9)), "has firmware 0.6.9 .*; 'endpoints' is for 0.6.10"),
        (lambda rig: setattr(of(rig), "hardware", (5, 2, 0)), "on hardware 5.2.0"),
        (lambda rig: setattr(of(rig), "firmware", (0, 7, 0)), "has firmware 0.7.0; the profile says 0.6"),
        (lambda rig: setattr(of(rig, 1), "node", 1), "several ODrives have this node id"),
        (lambda rig: setattr(of(rig), "state", 3), "is in full calibration, not idle"),
        (lambda rig: setattr(of(rig), "torque_constant", 0.05), "has a torque constant of 0.05 N m/A; the profile"),
        (lambda rig: setattr(of(rig), "torque_constant", float("nan")), "has a torque constant of nan"),
        (lambda rig: setattr(of(rig), "torque_constant_at", 7), "doesn't tell its torque constant"),
        (lambda rig: setattr(of(rig), "timeout_at", 7), "doesn't keep its watchdog's setting"),
    ],
)
def test_a_bus_that_isn_t_the_profile_s_is_refused(change, match, monkeypatch):
    monkeypatch.setattr("srl.drivers.odrive.opening.SETTLE", 0.0)
    if "several" in match:
        config = odrive(names=("hip", "knee"))

        def two(rig):
            change(rig)
            rig.driver.options = odrive(names=("hip",))

        open_with(two, match, config)
    else:
        open_with(change, match)


def test_swapped_ids_are_refused_by_the_serial_number():
    config = odrive(axis={"serial": None})
    one, two = config.axes["hip"], config.axes["knee"]
    config = config.model_copy(
        update={
            "axes": {
                "hip": one.model_copy(update={"serial": "35640000AAAA"}),
                "knee": two.model_copy(update={"serial": "35640000BBBB"}),
            }
        }
    )

    def swap(rig):
        of(rig).node, of(rig, 1).node = 2, 1

    open_with(swap, "has the serial number 35640000BBBB; the profile says 35640000AAAA", config)


def test_another_firmware_than_the_profile_s():
    config = odrive(firmware="0.5")
    with TwinRig(odrive(), floating(config), opened=False) as rig:
        rig.driver.options = config.model_copy(update={"port": rig.driver.config.port})
        with pytest.raises(DeviceError, match=r"has firmware 0.6.10; the profile says 0.5"):
            rig.open()
    with TwinRig(config, floating(config), opened=False) as rig:
        rig.driver.options = odrive().model_copy(update={"port": rig.driver.config.port})
        with pytest.raises(DeviceError, match="doesn't tell its version"):
            rig.open()


def test_an_axis_that_isn_t_parked_is_refused():
    config = odrive()
    world = cell("odrive", ("hip", "knee"), start=0.6, gravity=False)
    with (
        TwinRig(config, world, opened=False) as rig,
        pytest.raises(DeviceError, match=r"says that it is at 0.60 rad; it must be parked at 0 rad"),
    ):
        rig.open()


def test_an_absolute_encoder_needs_no_parking():
    config = odrive(axis={"encoder": "axis", "parked": None, "lower": -2.0, "upper": 2.0})
    with TwinRig(config, cell("odrive", ("hip", "knee"), start=0.6, gravity=False)) as rig:
        rig.run(0.05)
        assert rig.driver.state_arrays["position"] == pytest.approx([0.6, 0.0], abs=1e-3)
        of(rig).brown_out()
        rig.run(0.3)
        assert rig.driver.state_arrays["position"] == pytest.approx([0.6, 0.0], abs=1e-3)
        assert fault(rig) == ""
