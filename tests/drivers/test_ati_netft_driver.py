"""The Net F/T driver against its twin over real loopback sockets, and against scripted answers."""

import socket
import threading
import time

import numpy as np
import pytest
from helpers.ft import Server, at_sensor, bound, cell, push, read
from helpers.wait import until

from srl.drivers.ati_netft import AtiNetFt
from srl.drivers.ati_netft.config import AtiNetFtConfig, address
from srl.drivers.ati_netft.protocol import Record, Request, parse_request, record
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.ati_netft.fake import FakeAtiNetFt, FakeAtiNetFtOptions
from srl.sim.devices.ati_netft.twin import AtiNetFtTwin

PLACEHOLDER = AtiNetFtConfig(port="udp://127.0.0.1")


def twin(world=None, **options):
    return AtiNetFtTwin(FakeAtiNetFt("ft", PLACEHOLDER, world or cell(), FakeAtiNetFtOptions(**options)))


def driver(server, **options):
    return bound(AtiNetFt("ft", AtiNetFtConfig(port=server.twin.address, **options)))


@pytest.fixture
def server():
    with Server(twin(noise=0.0)) as running:
        yield running


@pytest.fixture
def opened(server):
    ft = driver(server)
    ft.open()
    yield ft
    ft.close()


def fresh(ft):
    """Reads until one more sample was taken."""
    until(lambda: newer(ft))


def newer(ft):
    """Reads; whether that was a newer sample."""
    before = ft.health.stamp
    read(ft)
    return ft.health.stamp > before


def settled(ft, wrench, within=1e-3):
    until(lambda: np.allclose(ft.state_arrays["wrench"], wrench, atol=within), lambda: read(ft))


def test_the_wrench_is_what_pushes_the_handle(server, opened):
    for wrench in ((12.0, 0, 0, 0, 0, 0), (0, -7.0, 3.0, 0, 0, 0.5), (0, 0, 0, 0.2, -0.3, 0)):
        with server.paused():
            push(server.world, *wrench)
        settled(opened, at_sensor(server.world, *wrench))
    assert opened.health.message == "Ethernet Axia"
    assert opened.health.connected
    assert opened.metrics()["product"] == "Ethernet Axia"


def test_without_records_the_sample_grows_old(server, opened):
    fresh(opened)
    with server.paused():
        until(lambda: not newer(opened), what="the last record that was under way before the pause", pause=0.05)
        newest = opened.health.stamp
        opened.read(time.monotonic_ns() + 500_000_000)
        assert opened.health.stamp == newest
    fresh(opened)
    assert opened.health.stamp <= time.monotonic_ns()


def test_a_backlog_is_drained_to_the_newest_and_an_old_record_isn_t_fresh(server, opened):
    until(lambda: opened.health.frames > 200, lambda: read(opened))
    time.sleep(0.15)  # the backlog
    with server.paused():
        time.sleep(0.05)  # the age of its newest
        now = time.monotonic_ns()
        opened.read(now)
        assert now - opened.health.stamp >= 40_000_000  # the newest waited at least for the pause


def test_saturation_isn_t_a_sample(server, opened):
    fresh(opened)
    with server.paused():
        push(server.world, 500.0, 0, 0, 0, 0, 0)
    until(lambda: "force or torque out of range" in opened.health.message, lambda: read(opened))
    stamp, errors = opened.health.stamp, opened.health.errors
    until(lambda: opened.health.errors > errors + 20, lambda: read(opened))
    assert opened.health.stamp == stamp
    assert abs(opened.state_arrays["wrench"][0]) < 400
    with server.paused():
        push(server.world, 1.0, 0, 0, 0, 0, 0)
    settled(opened, at_sensor(server.world, 1.0, 0, 0, 0, 0, 0))
    assert opened.health.message == "Ethernet Axia"


def test_errors_are_named(server, opened):
    server.twin.trouble = 1 << 2
    until(lambda: "broken gage" in opened.health.message, lambda: read(opened))
    assert "80000004" in opened.health.message


def test_the_latch_is_a_remark_and_recover_resets_it(server, opened):
    with server.paused():
        server.twin.threshold = 5.0
        push(server.world, 8.0, 0, 0, 0, 0, 0)
    until(lambda: opened.metrics()["latched"], lambda: read(opened))
    assert "latched" in opened.health.message
    fresh(opened)  # it still counts as good
    with server.paused():
        push(server.world, 1.0, 0, 0, 0, 0, 0)
    until(lambda: server.twin.counts_now()[0] < 2e6)
    opened.recover(time.monotonic_ns())
    until(lambda: not opened.metrics()["latched"], lambda: read(opened))
    fresh(opened)


def test_the_latch_is_reset_at_opening_where_the_profile_says_so(server):
    with server.paused():
        server.twin.threshold = 5.0
        push(server.world, 8.0, 0, 0, 0, 0, 0)
    until(server.twin.status)
    with server.paused():
        push(server.world, 1.0, 0, 0, 0, 0, 0)
    until(lambda: server.twin.counts_now()[0] < 2e6)
    for reset in (False, True):
        ft = driver(server, reset_latch=reset)
        ft.open()
        # Records that were under way before may still come.
        until(lambda ft=ft, latched=not reset: newer(ft) and ft.metrics()["latched"] is latched)
        ft.close()
        assert server.twin.metrics()["requests"].get("RESET_LATCH", 0) == reset


def test_missing_records_are_counted():
    with Server(twin(noise=0.0, dropout=0.2)) as server:
        ft = driver(server)
        ft.open()
        until(lambda: ft.health.frames > 500, lambda: read(ft))
        share = ft.metrics()["missed"] / (ft.metrics()["missed"] + ft.health.frames)
        assert 0.1 < share < 0.3
        ft.close()


def test_a_silent_stream_is_asked_for_again(server, opened):
    fresh(opened)
    thief = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    host = address(server.twin.address, "test")
    thief.sendto(bytes.fromhex("1234000000000000"), (host.host, host.rdt))  # another program stops it
    until(lambda: opened.metrics()["asked_again"] >= 1, lambda: read(opened))
    fresh(opened)
    assert opened.metrics()["rejected"] == 0
    assert opened.health.reconnects == 0
    thief.close()


def test_a_dead_sensor_is_lost_and_comes_back(server, opened):
    fresh(opened)
    server.twin.muted = True
    begin = time.monotonic_ns()
    opened.read(begin)
    with pytest.raises(DeviceLostError, match="no records for 2 s"):
        until(lambda: False, lambda: opened.read(begin + 2_500_000_000))
    assert not opened.health.connected
    server.twin.muted = False
    frames = opened.health.frames
    opened.open()
    assert opened.health.reconnects == 1
    fresh(opened)
    assert opened.health.frames > frames


def test_a_pulled_cable_is_a_loss(server, opened):
    fresh(opened)
    with server.paused():
        server.twin.close()
    with pytest.raises(DeviceLostError):
        until(lambda: False, lambda: opened.read(time.monotonic_ns() + 10**10))
    opened.close()
    opened.close()


def test_a_sensor_that_restarted_is_opened_anew(server, opened):
    until(lambda: opened.health.frames > 400, lambda: read(opened))
    with server.paused():
        server.twin.power_cycle()
    with pytest.raises(DeviceLostError, match="has restarted"):
        until(lambda: False, lambda: read(opened))
    opened.open()
    fresh(opened)


def test_bias_takes_the_load_for_zero_once_and_again_after_a_restart():
    with Server(twin(noise=0.01, offset=(5.0, -6.0, 30.0, 0.4, 0.0, -0.2))) as server:
        ft = driver(server, bias=True)
        ft.open()
        settled(ft, np.zeros(6), 0.2)
        assert server.twin.metrics()["requests"]["BIAS"] == 1
        ft.close()
        ft.open()  # the same sensor, still biased: not again
        assert server.twin.metrics()["requests"]["BIAS"] == 1
        until(lambda: ft.health.frames > 400, lambda: read(ft))
        with server.paused():
            server.twin.power_cycle()
        with pytest.raises(DeviceLostError):
            until(lambda: False, lambda: read(ft))
        ft.open()
        settled(ft, np.zeros(6), 0.2)
        assert server.twin.metrics()["requests"]["BIAS"] == 2
        ft.close()


def test_a_load_that_moves_isn_t_taken_for_zero():
    world = cell(handle={"pushes": [{"start": 0.02 * k, "end": 0.02 * k + 0.01, "wrench": (30, 0, 0, 0, 0, 0)}
                                    for k in range(2000)]})  # fmt: skip
    with Server(twin(world, noise=0.0)) as server:
        ft = driver(server, bias=True)
        with pytest.raises(DeviceError, match=r"load moves.*Let go"):
            ft.open()
        assert not ft.health.connected


def test_the_rate_is_set_over_http(server):
    ft = driver(server, rate=100)
    ft.open()
    assert server.twin.record_rate == 100
    fresh(ft)
    ft.close()


def test_counts_by_the_tcp_port_where_there_is_no_page(server):
    tcp = server.twin.tcp.port
    port = f"udp://127.0.0.1:{server.twin.records.port}?http=1&tcp={tcp}"
    ft = bound(AtiNetFt("ft", AtiNetFtConfig(port=port)))
    ft.open()
    with server.paused():
        push(server.world, 0, 4.0, 0, 0, 0, 0)
    settled(ft, at_sensor(server.world, 0, 4.0, 0, 0, 0, 0))
    ft.close()


def test_counts_by_the_profile(server):
    ft = driver(server, counts={"force": 500_000, "torque": 2_000_000}, family="axia", sample_rate=1000)
    ft.open()
    with server.paused():
        push(server.world, 0, 4.0, 0, 0, 0, 0)
    expected = at_sensor(server.world, 0, 4.0, 0, 0, 0, 0) * ([2.0] * 3 + [0.5] * 3)
    settled(ft, expected)
    ft.close()


def test_another_product_is_refused(server):
    with pytest.raises(DeviceError, match="this sensor is 'Ethernet Axia', the profile says 'Nano17'"):
        driver(server, product="Nano17").open()
    driver(server, product="axia").open()


def test_a_tool_transform_that_the_profile_does_not_know_is_refused(server):
    """It turns what x, y and z are."""
    with pytest.raises(DeviceError, match="tool transform is 0, 0, 0, 0, 0, 0, the profile says transformed: True"):
        driver(server, transformed=True).open()
    server.twin.transform = (0.0, 0.0, 0.0, 0.0, 0.0, 90.0)
    with pytest.raises(DeviceError, match="tool transform is 0, 0, 0, 0, 0, 90, the profile says transformed: False"):
        driver(server).open()
    driver(server, transformed=True).open()


def test_nobody_there_is_said_with_a_remedy():
    with pytest.raises(DeviceError, match=r"gives no settings: port 1 refuses.*port 1 refuses.*power"):
        AtiNetFt("ft", AtiNetFtConfig(port="udp://127.0.0.1:9?http=1&tcp=1")).open()


def test_a_web_server_that_is_no_sensor_is_refused():
    door = socket.create_server(("127.0.0.1", 0))

    def serve():
        link, _ = door.accept()
        link.recv(4096)
        link.sendall(b"HTTP/1.0 200 OK\r\n\r\n<html><body>printer</body></html>")
        link.close()

    thread = threading.Thread(target=serve)
    thread.start()
    port = door.getsockname()[1]
    with pytest.raises(DeviceError, match="is no ATI Net F/T: the page's root is <html>"):
        AtiNetFt("ft", AtiNetFtConfig(port=f"udp://127.0.0.1:9?http={port}")).open()
    thread.join()
    door.close()


@pytest.mark.parametrize(
    "port", ["/dev/ttyUSB0", "tcp://h:1", "udp://", "udp://h?x=1", "udp://h?http=no", "udp://h:99999"]
)
def test_a_wrong_port_is_said(port):
    with pytest.raises(DeviceError, match="isn't udp://HOST"):
        AtiNetFt("ft", AtiNetFtConfig(port=port)).open()


class Scripted:
    """A sensor that answers START with the records the test gives, over UDP."""

    def __init__(self, *first):
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link.bind(("127.0.0.1", 0))
        self.port = f"udp://127.0.0.1:{self.link.getsockname()[1]}"
        self.first, self.peer, self.asked = first, None, 0
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        while self.peer is None:
            data, peer = self.link.recvfrom(100)
            if parse_request(data)[0] == Request.START:
                self.asked += 1
                for item in self.first:
                    self.link.sendto(item, peer)
                if self.first and len(self.first[-1]) == 36:
                    self.peer = peer

    def send(self, *records):
        until(lambda: self.peer)
        for item in records:
            self.link.sendto(record(item), self.peer)

    def driver(self, **options):
        config = AtiNetFtConfig(port=self.port, counts={"force": 1e6, "torque": 1e6}, **options)
        return bound(AtiNetFt("ft", config))


def rec(sequence, sample=None, status=0, fx=0):
    return Record(sequence, sequence if sample is None else sample, status, (fx, 0, 0, 0, 0, 0))


def test_overtaken_and_repeated_records_are_thrown_away_and_gaps_counted():
    sensor = Scripted(record(rec(1)))
    ft = sensor.driver(sample_rate=1000)
    ft.open()
    sensor.send(rec(2, fx=2), rec(5, fx=5), rec(3, fx=3), rec(5, fx=5), rec(6, fx=6_000_000))
    until(lambda: ft.health.frames == 6, lambda: read(ft))
    assert ft.metrics()["missed"] == 2
    assert ft.metrics()["rejected"] == 2
    assert ft.state_arrays["wrench"][0] == 6.0
    ft.close()


def test_the_sequence_wraps():
    sensor = Scripted(record(rec(2**32 - 2, 2**32 - 2)))
    ft = sensor.driver(sample_rate=1000)
    ft.open()
    sensor.send(rec(2**32 - 1), rec(0), rec(1, fx=1_000_000))
    until(lambda: ft.health.frames == 4, lambda: read(ft))
    assert (ft.metrics()["missed"], ft.metrics()["rejected"]) == (0, 0)
    assert ft.state_arrays["wrench"][0] == 1.0
    ft.close()


def test_stamps_follow_the_sample_counter():
    sensor = Scripted(record(rec(1, 1000)))
    ft = sensor.driver(sample_rate=1000)
    ft.open()
    at = 10**12
    sensor.send(rec(2, 1001))
    until(lambda: ft.health.frames == 2, lambda: ft.read(at))
    assert ft.health.stamp == at
    sensor.send(rec(3, 1011))  # 10 ms on by its own count, found 60 ms later
    until(lambda: ft.health.frames == 3, lambda: ft.read(at + 60_000_000))
    assert ft.health.stamp == pytest.approx(at + 10_000_000, abs=20_000)
    ft.close()


def test_something_that_sends_no_records_is_refused(monkeypatch):
    monkeypatch.setattr("srl.drivers.ati_netft.driver.ANSWER", 0.02)
    sensor = Scripted(b"hello")
    with pytest.raises(DeviceError, match="datagrams that are no records though it was asked 10 times"):
        sensor.driver().open()
    assert sensor.asked >= 1


def test_a_host_s_name_that_can_t_be_is_said():
    with pytest.raises(DeviceError, match=r"a\.\.b gives no settings"):
        AtiNetFt("ft", AtiNetFtConfig(port="udp://a..b")).open()


def test_counts_without_end_are_refused():
    with pytest.raises(ValueError, match="finite"):
        AtiNetFtConfig(port="udp://h", counts={"force": float("inf"), "torque": 1.0})
