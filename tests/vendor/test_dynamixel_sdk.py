"""dynamixel-sdk, unchanged, on the twin's pty: both protocols, and a motion that is physics."""

from pathlib import Path

import numpy as np
import pytest
from helpers.dynamixel import THREE, make_twin
from helpers.twin import Bench
from helpers.wait import until

sdk = pytest.importorskip("dynamixel_sdk")

from srl.drivers.dynamixel.models import MODELS  # noqa: E402
from srl.drivers.dynamixel.table import table2  # noqa: E402


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """The SDK gives an answer 34 ms, less than a busy test machine may let the twin's thread wait."""
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 400)


class Bus:
    """The SDK's two handlers on a running twin."""

    def __init__(self, protocol: int, motors: dict = THREE, **options: object) -> None:
        self.twin = make_twin(motors, protocol=protocol)
        for servo in self.twin.servos:
            servo.put("return_delay_time", 0)
        for name, value in options.items():
            setattr(self.twin, name, value)
        self.bench = Bench(self.twin)
        self.packets = sdk.PacketHandler(float(protocol))

    def __enter__(self) -> "Bus":
        self._running = self.bench.running()
        self._running.__enter__()
        self.port = sdk.PortHandler(self.twin.address)
        assert self.port.setBaudRate(1_000_000)
        return self

    def __exit__(self, *error: object) -> None:
        self.port.closePort()
        self._running.__exit__(*error)
        self.twin.close()

    def truth(self) -> np.ndarray:
        return self.twin.bus.world.truth_arrays["arm_position"].copy()


def good(answer: tuple) -> object:
    """The value of (value, result, error) or (result, error), which must be well."""
    *values, result, error = answer
    assert (result, error) == (sdk.COMM_SUCCESS, 0)
    return values[0] if values else None


@pytest.mark.slow
def test_protocol_2_single_packets():
    with Bus(2) as bus:
        p, port = bus.packets, bus.port
        assert [good(p.ping(port, id)) for id in (1, 2, 3)] == [321, 311, 30]
        found, result = p.broadcastPing(port)
        assert result == sdk.COMM_SUCCESS
        assert found == {1: [321, 42], 2: [311, 42], 3: [30, 42]}
        assert good(p.read4ByteTxRx(port, 1, 132)) == 2048
        good(p.write1ByteTxRx(port, 1, 64, 1))
        assert p.write1ByteTxRx(port, 1, 11, 4) == (sdk.COMM_SUCCESS, 7)  # locked while the torque is on
        assert p.write4ByteTxRx(port, 1, 116, 5000) == (sdk.COMM_SUCCESS, 6)
        assert p.write1ByteTxRx(port, 2, 11, 9) == (sdk.COMM_SUCCESS, 4)
        assert p.write2ByteTxRx(port, 2, 144, 1) == (sdk.COMM_SUCCESS, 7)  # read-only
        assert p.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
        good(p.regWriteTxRx(port, 1, 116, 4, [0, 9, 0, 0]))
        assert good(p.read4ByteTxRx(port, 1, 116)) == 2048
        p.action(port, 254)
        until(lambda: good(p.read4ByteTxRx(port, 1, 116)) == 0x900)
        good(p.factoryReset(port, 1, 0x02))  # all but its id and its baud rate
        until(lambda: p.ping(port, 1)[1] == sdk.COMM_SUCCESS)
        good(p.reboot(port, 1))
        until(lambda: p.ping(port, 1)[1] == sdk.COMM_SUCCESS)
        assert good(p.read1ByteTxRx(port, 1, 64)) == 0


def test_protocol_2_groups_and_a_motion():
    with Bus(2) as bus:
        p, port = bus.packets, bus.port
        torque = sdk.GroupSyncWrite(port, p, 64, 1)
        goals = sdk.GroupSyncWrite(port, p, 116, 4)
        state = sdk.GroupSyncRead(port, p, 126, 10)
        wanted = {1: 2048 + 300, 2: 2048 - 200, 3: 2048 + 150}
        for id, goal in wanted.items():
            torque.addParam(id, [1])
            goals.addParam(id, list(goal.to_bytes(4, "little")))
            state.addParam(id)
        assert torque.txPacket() == sdk.COMM_SUCCESS
        assert goals.txPacket() == sdk.COMM_SUCCESS
        seen = []

        def arrived() -> bool:
            assert state.txRxPacket() == sdk.COMM_SUCCESS
            seen.append([state.getData(id, 132, 4) for id in wanted])
            return all(abs(a - b) < 12 for a, b in zip(seen[-1], wanted.values(), strict=True))

        until(arrived)
        between = [row[0] for row in seen]
        assert any(2060 < place < 2300 for place in between)  # it took its way, and time for it
        np.testing.assert_allclose(bus.truth()[:2], np.array([300, -200]) * 2 * np.pi / 4096, atol=0.02)
        bulk = sdk.GroupBulkRead(port, p)
        bulk.addParam(1, 144, 2)
        bulk.addParam(2, 146, 1)
        assert bulk.txRxPacket() == sdk.COMM_SUCCESS
        assert (bulk.getData(1, 144, 2), bulk.getData(2, 146, 1)) == (120, 25)
        write = sdk.GroupBulkWrite(port, p)
        write.addParam(1, 116, 4, [0, 8, 0, 0])
        write.addParam(2, 104, 4, [100, 0, 0, 0])
        assert write.txPacket() == sdk.COMM_SUCCESS
        until(lambda: abs(bus.truth()[0]) < 0.02)
        assert good(p.read4ByteTxRx(port, 2, 104)) == 100


def test_fast_sync_read_is_silence_on_an_mx_and_read_right_where_it_is_known():
    with Bus(2) as bus:
        group = sdk.GroupSyncRead(bus.port, bus.packets, 132, 4)
        for id in (1, 2, 3):
            group.addParam(id)
        assert group.fastSyncRead() != sdk.COMM_SUCCESS
        bus.twin.fast = True
        assert group.fastSyncRead() == sdk.COMM_SUCCESS
        assert [group.getData(id, 132, 4) for id in (1, 2, 3)] == [2048] * 3


def test_protocol_1():
    with Bus(1) as bus:
        p, port = bus.packets, bus.port
        assert [good(p.ping(port, id)) for id in (1, 2, 3)] == [320, 310, 29]
        good(p.write1ByteTxRx(port, 1, 24, 1))
        goals = sdk.GroupSyncWrite(port, p, 30, 2)
        goals.addParam(1, list((2348).to_bytes(2, "little")))
        goals.addParam(3, list((2000).to_bytes(2, "little")))
        assert goals.txPacket() == sdk.COMM_SUCCESS
        until(lambda: abs(good(p.read2ByteTxRx(port, 1, 36)) - 2348) < 12)
        np.testing.assert_allclose(bus.truth()[0], 300 * 2 * np.pi / 4096, atol=0.02)
        # Its own GroupBulkRead.txRxPacket() raises a TypeError in protocol 1 (sheet, §6): its two halves work.
        bulk = sdk.GroupBulkRead(port, p)
        for id in (1, 2):
            bulk.addParam(id, 36, 8)
        p.bulkReadTx(port, [8, 1, 36, 8, 2, 36], 6)
        assert bulk.rxPacket() == sdk.COMM_SUCCESS
        assert abs(bulk.getData(1, 36, 2) - 2348) < 12
        assert bulk.getData(2, 42, 1) == 120
        result, error = p.write2ByteTxRx(port, 1, 30, 4096)
        assert (result, error & 2) == (sdk.COMM_SUCCESS, 2)  # beyond its angle limit


MIXED = {"a": {"model": "XL330-M288"}, "b": {"model": "XM430-W350"}, "c": {"model": "XL430-W250"}}


def test_a_mixed_bus_of_x_servos():
    with Bus(2, MIXED) as bus:
        p, port = bus.packets, bus.port
        found, result = p.broadcastPing(port)
        assert result == sdk.COMM_SUCCESS
        assert found == {1: [1200, 42], 2: [1020, 42], 3: [1060, 42]}
        assert [good(p.read2ByteTxRx(port, id, 144)) for id in (1, 2, 3)] == [50, 120, 111]  # 0.1 V
        assert [good(p.read4ByteTxRx(port, id, 44)) for id in (1, 2, 3)] == [445, 200, 265]  # 0.229 rpm
        assert [good(p.read2ByteTxRx(port, id, 38)) for id in (1, 2)] == [1750, 1193]
        assert p.read2ByteTxRx(port, 1, 578)[2] == 7  # an XL330 ends before
        assert p.write1ByteTxRx(port, 3, 11, 5) == (sdk.COMM_SUCCESS, 4)  # an XL430 has no current
        for id in (1, 2):
            good(p.write1ByteTxRx(port, id, 11, 5))
        good(p.write2ByteTxRx(port, 1, 102, 100))
        good(p.write2ByteTxRx(port, 2, 38, 500))
        assert p.write2ByteTxRx(port, 2, 102, 501) == (sdk.COMM_SUCCESS, 6)  # beyond its current limit
        for id, goal in ((1, 2248), (2, 1848), (3, 2148)):
            good(p.write1ByteTxRx(port, id, 64, 1))
            good(p.write4ByteTxRx(port, id, 116, goal))
        group = sdk.GroupSyncRead(port, p, 126, 10)
        for id in (1, 2, 3):
            group.addParam(id)

        def arrived() -> bool:
            assert group.txRxPacket() == sdk.COMM_SUCCESS
            amps = group.getData(1, 126, 2)
            assert min(amps, 65536 - amps) <= 100  # 1 mA
            there = [group.getData(id, 132, 4) for id in (1, 2, 3)]
            return bool(np.abs(np.array(there) - (2248, 1848, 2148)).max() < 12)

        until(arrived)
        np.testing.assert_allclose(bus.truth(), np.array([200, -200, 100]) * 2 * np.pi / 4096, atol=0.02)


FILES = {name: f"{name.lower().replace('-', '_')}.model" for name in MODELS} | {
    name: f"{name.lower().replace('-', '_')}_fw52.model" for name in MODELS if name[:5] in ("XL330", "XC330")
}


@pytest.mark.parametrize("name", FILES)
def test_our_registers_are_those_of_the_vendor_s_model_files(name):
    folder = Path(sdk.__file__).parents[1] / "dynamixel_easy_sdk" / "control_table"
    text = (folder / FILES[name]).read_text()
    lines = [line.split("\t") for line in text.split("[control table]")[1].splitlines()[2:] if line.strip()]
    vendor = {int(address): (int(size), title) for address, size, title in (line[:3] for line in lines)}
    ours = {register.address: register.size for register in table2(MODELS[name]).values()}
    assert len(vendor) > 40
    for address, (size, title) in vendor.items():
        assert ours.get(address) == size, (address, title)


def test_our_model_numbers_are_the_vendor_s():
    folder = Path(sdk.__file__).parents[1] / "dynamixel_easy_sdk" / "control_table"
    lines = [line.split("\t") for line in (folder / "dynamixel.model").read_text().splitlines()[1:] if line.strip()]
    vendor = {file.removesuffix(".model"): int(number) for number, file in lines}
    ours = {name.lower().replace("-", "_"): model.number2 for name, model in MODELS.items()}
    assert {name: vendor.get(name, number) for name, number in ours.items()} == ours
    assert ours.keys() - vendor.keys() == {"xw430_t200"}  # it has a table there, and no number
