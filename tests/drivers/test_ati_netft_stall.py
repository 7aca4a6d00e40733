"""Force/torque sensors in a process that is stopped and goes on: old samples are never taken for fresh."""

import time

import pytest
from helpers.peer import Peer, bound, cycles
from helpers.wait import until

from srl.drivers.ati_netft import AtiNetFt
from srl.drivers.ati_netft.config import AtiNetFtConfig
from srl.drivers.can_ft import CanFt
from srl.drivers.can_ft.driver import CanFtConfig

WORLD = {"world": "cell", "parts": {"sensor": {"part": "ft-sensor"}}}
SENSORS = {"ati-netft": (AtiNetFt, AtiNetFtConfig), "can-ft": (CanFt, CanFtConfig)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SENSORS)
def test_a_stopped_sensor_grows_old_and_goes_on(kind):
    device, config = SENSORS[kind]
    with Peer(kind, {"port": "udp://127.0.0.1"} if kind == "ati-netft" else {}, world=WORLD) as peer:
        ft = bound(device("ft", config(port=peer.address)))
        ft.open()
        try:
            cycles(ft, 0.3, 100)
            assert ft.health.stamp > 0
            peer.stop()
            cycles(ft, 0.8, 100)
            stopped = ft.health.stamp
            assert time.monotonic_ns() - stopped > 500_000_000
            assert ft.health.connected
            peer.cont()
            until(lambda: ft.health.stamp > stopped + 500_000_000, lambda: ft.read(time.monotonic_ns()))
            assert ft.health.reconnects == 0
        finally:
            ft.close()
