"""odrive-can, unchanged, on the twin; its DBC as a judge of every frame; and this driver on odrive-can's own mock."""

import asyncio
import os
import threading
import time

import can
import pytest
from helpers.can_drives import TwinRig, cell, odrive
from helpers.twin import bound
from helpers.wait import until

from srl.drivers.odrive import Odrive, opening, protocol
from srl.runtime.contracts.errors import DeviceError

odrive_can = pytest.importorskip("odrive_can")
from odrive_can.mock import ODriveCANMock  # noqa: E402
from odrive_can.odrive import DriveError, ODriveCAN  # noqa: E402


@pytest.fixture
def twin():
    config = odrive()
    with TwinRig(config, cell("odrive", ("hip", "knee"), gravity=False), opened=False) as rig, rig.bench.running():
        yield rig


def bus_of(rig):
    return can.Bus(interface="virtual", channel=rig.twin.address.removeprefix("can://virtual/"))


def client(rig, play):
    """Runs a coroutine of a client on axis 1."""

    async def whole():
        drive = ODriveCAN(axis_id=1, can_bus=bus_of(rig))
        await drive.start()
        try:
            return await play(drive)
        finally:
            drive.stop()

    return asyncio.run(whole())


def test_the_public_client_drives_the_twin(twin):
    node = twin.twin.nodes[0]

    async def play(drive):
        drive.check_errors()
        drive.clear_errors()
        volts = await drive.get_bus_voltage_current()  # first: a cyclic message may pass for an answer of its own id
        await drive.set_axis_state("CLOSED_LOOP_CONTROL")
        drive.set_controller_mode("POSITION_CONTROL", "PASSTHROUGH")
        drive.set_input_pos(0.5)
        found = await drive.get_encoder_estimates()
        for _ in range(1000):
            if abs(found["Pos_Estimate"] - 0.5) < 0.01:
                break
            await asyncio.sleep(0.005)
            found = await drive.get_encoder_estimates()
        drive.check_alive()
        return found["Pos_Estimate"], volts["Bus_Voltage"]

    turns, volts = client(twin, play)
    assert turns == pytest.approx(0.5, abs=0.05)
    assert volts == 48.0
    truth = twin.bench.world.truth_arrays["arm_position"][0]
    assert truth == pytest.approx(0.5 * 2 * 3.1416 / 8, abs=0.05), "half a turn of a motor with a gear of 8"
    until(lambda: node.state == protocol.IDLE)  # it sends idle when it stops


def test_the_client_reads_the_twin_s_error(twin):
    async def play(drive):
        twin.twin.nodes[0].error = 1 << 24
        await drive.wait_for_heartbeat()
        await drive.wait_for_heartbeat()
        with pytest.raises(DriveError, match="WATCHDOG_TIMER_EXPIRED"):
            drive.check_errors()

    client(twin, play)


def test_every_frame_of_this_driver_is_in_the_dbc():
    """What the driver sends, decoded by the DBC of another author, is what was meant."""
    dbc = odrive_can.get_dbc()

    def output(message):
        entry = dbc.get_message_by_frame_id(message.arbitration_id)
        return entry.name, entry.decode(bytes(message.data))

    assert output(protocol.set_state(1, 8)) == ("Axis1_Set_Axis_State", {"Axis_Requested_State": "CLOSED_LOOP_CONTROL"})
    name, found = output(protocol.input_position(3, -1.25, 0.5, -0.1))
    assert name == "Axis3_Set_Input_Pos"
    assert [found[key] for key in ("Input_Pos", "Vel_FF", "Torque_FF")] == pytest.approx([-1.25, 0.5, -0.1])
    name, found = output(protocol.set_mode(2, "torque"))
    assert found == {"Control_Mode": "TORQUE_CONTROL", "Input_Mode": "PASSTHROUGH"}
    assert output(protocol.input_torque(2, 0.75))[1] == {"Input_Torque": 0.75}
    assert output(protocol.set_limits(1, 20.0, 15.0))[1] == {"Velocity_Limit": 20.0, "Current_Limit": 15.0}
    for command in (0x00, 0x03, 0x06, 0x14, 0x15, 0x17, 0x1C):
        dbc.get_message_by_frame_id(protocol.identifier(1, command))


@pytest.mark.slow
def test_this_driver_moves_the_client_s_own_mock(monkeypatch):
    """The mock has no version (it says 0.0.0), so the driver refuses it; without that check it drives it."""
    name = f"mock{os.getpid()}"
    mock = ODriveCANMock(1, can_bus=can.Bus(interface="virtual", channel=name))
    mock.set_rate_of_change(0.5)
    ended = threading.Event()

    async def serve():
        task = asyncio.create_task(mock.main())
        while not ended.is_set():
            await asyncio.sleep(0.01)
        task.cancel()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    driver = bound(Odrive("limb", odrive(names=("hip",), firmware="0.5", port=f"can://virtual/{name}")))
    try:
        with pytest.raises(DeviceError, match=r"has firmware 0.0.0; the profile says 0.5"):
            driver.open()
        monkeypatch.setattr(opening, "LISTEN", 10.0)
        monkeypatch.setattr(opening, "check", lambda *_: "the mock")
        driver.open()
        position = driver.state_arrays["position"]

        def cycle(wanted):
            now = time.monotonic_ns()
            driver.read(now)
            driver.command_arrays["position_command"][:] = wanted
            driver.write(now)
            time.sleep(0.005)

        until(lambda: driver.drives[0].armed, lambda: cycle(0.0))
        assert mock.odrive.axis_state == "CLOSED_LOOP_CONTROL"
        until(lambda: abs(position[0] - 0.3) < 0.01, lambda: cycle(0.3), what=lambda: f"{position} {driver.health}")
        assert mock.odrive.model.setpoint == pytest.approx(0.3 * 8 / (2 * 3.14159), abs=1e-3)
        assert driver.health.fault == ""
    finally:
        driver.close()
        ended.set()
        thread.join()
