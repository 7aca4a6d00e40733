"""ftservo-python-sdk, unchanged, on the twin's pty. It has the import name of feetech-servo-sdk: one is installed."""

import pytest
from helpers.feetech import make_twin
from helpers.twin import Bench
from helpers.wait import until

sdk = pytest.importorskip("scservo_sdk")
if not hasattr(sdk, "sms_sts"):
    pytest.skip("this is feetech-servo-sdk, which has the same import name", allow_module_level=True)


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """A busy test machine may let the twin's thread wait for longer than a servo takes."""

    def generous(self, length):
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = 400.0

    monkeypatch.setattr(sdk.PortHandler, "setPacketTimeout", generous)


def test_it_pings_moves_and_reads():
    twin = make_twin()
    bench = Bench(twin)
    with bench.running():
        port = sdk.PortHandler(twin.address)
        assert port.openPort()
        assert port.setBaudRate(1_000_000)
        servo = sdk.sms_sts(port)
        assert servo.ping(2) == (777, sdk.COMM_SUCCESS, 0)
        assert servo.WritePosEx(2, 2300, 1000, 50) == (sdk.COMM_SUCCESS, 0)
        assert servo.write1ByteTxRx(2, 40, 1) == (sdk.COMM_SUCCESS, 0)

        def arrived() -> bool:
            position, result, error = servo.ReadPos(2)
            assert (result, error) == (sdk.COMM_SUCCESS, 0)
            return abs(position - 2300) < 12

        until(arrived)
        # Its goal of -100 isn't sign and magnitude: a servo takes it for -32668, and goes to its lower limit.
        servo.WritePosEx(2, -100, 1000, 50)
        until(lambda: twin.servos[1].get("goal_position") == -32668)
        port.closePort()
    twin.close()
