"""scservo_sdk (feetech-servo-sdk), unchanged, on the twin's pty: packets, groups, and a motion that is physics."""

import numpy as np
import pytest
from helpers.feetech import make_twin
from helpers.twin import Bench
from helpers.wait import until

sdk = pytest.importorskip("scservo_sdk")
if not hasattr(sdk, "PacketHandler"):
    pytest.skip("this is ftservo-python-sdk, which has the same import name", allow_module_level=True)


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """The SDK sets itself a time that a byte takes, and far too short an end (sheet, section 5.3)."""

    def generous(self, length):
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = 400.0

    monkeypatch.setattr(sdk.PortHandler, "setPacketTimeout", generous)


class Bus:
    """The SDK's two handlers on a running twin."""

    def __init__(self) -> None:
        self.twin = make_twin()
        self.bench = Bench(self.twin)
        self.packets = sdk.PacketHandler(0)  # STS: the low byte first

    def __enter__(self) -> "Bus":
        self._running = self.bench.running()
        self._running.__enter__()
        self.port = sdk.PortHandler(self.twin.address)
        assert self.port.openPort()
        assert self.port.setBaudRate(1_000_000)
        return self

    def __exit__(self, *error: object) -> None:
        self.port.closePort()
        self._running.__exit__(*error)
        self.twin.close()


def good(answer: tuple) -> object:
    """The value of (value, result, error) or (result, error), which must be well."""
    *values, result, error = answer
    assert (result, error) == (sdk.COMM_SUCCESS, 0)
    return values[0] if values else None


def test_single_packets():
    with Bus() as bus:
        p, port = bus.packets, bus.port
        assert [good(p.ping(port, id)) for id in (1, 2)] == [2825, 777]
        assert good(p.read2ByteTxRx(port, 1, 56)) == 2048
        good(p.write1ByteTxRx(port, 1, 40, 1))
        assert good(p.read1ByteTxRx(port, 1, 40)) == 1
        good(p.regWriteTxRx(port, 1, 42, 2, [0, 9]))
        assert good(p.read2ByteTxRx(port, 1, 42)) == 2048
        assert p.action(port, 254) == sdk.COMM_SUCCESS
        until(lambda: good(p.read2ByteTxRx(port, 1, 42)) == 0x900)
        good(p.write1ByteTxRx(port, 2, 55, 0))
        good(p.write1ByteTxRx(port, 2, 7, 11))
        assert bus.twin.servos[1].kept[7] == 11
        bus.twin.bus.chain.motors.errors[1] = 32
        value, result, error = p.read2ByteTxRx(port, 2, 56)
        assert (value, result, error) == (2048, sdk.COMM_SUCCESS, 32)
        assert "Overload" in p.getRxPacketError(error)


def test_groups_and_a_motion():
    with Bus() as bus:
        p, port = bus.packets, bus.port
        torque = sdk.GroupSyncWrite(port, p, 40, 1)
        goals = sdk.GroupSyncWrite(port, p, 42, 2)
        state = sdk.GroupSyncRead(port, p, 56, 15)
        wanted = {1: 2048 + 300, 2: 2048 - 200}
        for id, goal in wanted.items():
            torque.addParam(id, [1])
            goals.addParam(id, list(goal.to_bytes(2, "little")))
            state.addParam(id)
        assert goals.txPacket() == sdk.COMM_SUCCESS
        assert torque.txPacket() == sdk.COMM_SUCCESS
        seen = []

        def arrived() -> bool:
            assert state.txRxPacket() == sdk.COMM_SUCCESS
            seen.append([state.getData(id, 56, 2) for id in wanted])
            return all(abs(a - b) < 12 for a, b in zip(seen[-1], wanted.values(), strict=True))

        until(arrived)
        assert any(2060 < row[0] < 2300 for row in seen)  # it took its way, and time for it
        truth = bus.twin.bus.world.truth_arrays["arm_position"]
        np.testing.assert_allclose(truth, np.array([300, -200]) * 2 * np.pi / 4096, atol=0.02)
        assert [state.getData(id, 62, 1) for id in wanted] == [120, 120]


def test_recentring_and_signs():
    with Bus() as bus:
        p, port = bus.packets, bus.port
        chain = bus.twin.bus.chain
        chain._data.qpos[chain._q[1]] = -85 * 2 * np.pi / 4096
        until(lambda: abs(good(p.read2ByteTxRx(port, 2, 56)) - 1963) < 3)
        good(p.write1ByteTxRx(port, 2, 40, 128))
        until(lambda: abs(good(p.read2ByteTxRx(port, 2, 56)) - 2048) < 3)
        raw = good(p.read2ByteTxRx(port, 2, 31))
        assert raw & 0x800
        assert abs((raw & 0x7FF) - 85) < 3
