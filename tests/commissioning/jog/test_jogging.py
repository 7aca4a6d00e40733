"""Keys to motion in lockstep: the cut profile, its law, its guard and its simulated device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from helpers.run import refused

from srl.commissioning.jog.hold import Hold
from srl.commissioning.jog.keys import Keys
from srl.commissioning.jog.profile_subset import PRESS, WAY, ProfileSubset, subset
from srl.commissioning.jog.session import FRESH
from srl.control.setpoint.jog import HOLD, REST
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array, Kind, Stop
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, State
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile

RIGHT, LEFT = b"\x1b[C", b"\x1b[D"
REPEAT = 0.033  # s, of a held key
PROFILES = ["servo-jog", "finger-jog", "hand-jog", "ur-jog", "base-jog"]


def made(name: str, *overrides: str, speed: float = 0.1, device: str | None = None) -> ProfileSubset:
    return subset(*profile.load(name, overrides), device, speed, [])


class Run:
    """A run whose terminal's bytes come at given times, and where the joints were commanded to be."""

    def __init__(self, subset: ProfileSubset, *, step: bool = False) -> None:
        self.subset, self.lockstep = subset, Lockstep(subset.graph)
        self.period = 1.0 / float(subset.profile.rate)
        self.keys, self.hold = Keys(), Hold(tuple(subset.speed), max(FRESH, 1.5 * self.period), step)
        self.now, self.typed = 0.0, list[tuple[float, bytes]]()
        row = subset.graph.row
        self.words = row.devices[subset.graph.layout.devices.index("terminal")]
        self.words[DEVICE.stamp], self.words[DEVICE.link] = -1, LINK_CONNECTED
        self.states = set[State]()
        self.go(REST + 0.2)

    def type(self, data: bytes, after: float = 0.0) -> None:
        self.typed.append((self.now + after, data))

    def held(self, data: bytes, seconds: float) -> float:
        """A key that is held from now on; returns the time of its last byte, s."""
        times = [0.0, *np.arange(0.5, seconds, REPEAT).tolist()]
        for after in times:
            self.type(data, after)
        return self.now + times[-1]

    def go(self, seconds: float) -> Array:
        """(k, n): what was commanded in each cycle."""
        found = []
        row = self.subset.graph.row
        for _ in range(round(seconds / self.period)):
            self.now += self.period
            data = b"".join(bytes_ for at, bytes_ in self.typed if at <= self.now)
            self.typed = [(at, bytes_) for at, bytes_ in self.typed if at > self.now]
            for key in self.keys.take(data, self.now):
                self.hold.key(key, self.now)
            row.views[WAY][:], row.views[PRESS][:] = self.hold.at(self.now)
            self.words[DEVICE.stamp] = (self.lockstep.count + 1) * self.lockstep.period
            self.states.add(self.lockstep.step())
            found.append(self.subset.actuator.applied.ravel().copy())
        return np.array(found)

    def way(self, commanded: Array) -> Array:
        """(k, n): how far the command went since the first of these cycles."""
        if self.subset.actuator.command.kind is Kind.VELOCITY:
            return np.cumsum(commanded, axis=0) * self.period
        return commanded - commanded[0]

    def speeds(self, commanded: Array) -> Array:
        """(k - 1, n)."""
        if self.subset.actuator.command.kind is Kind.VELOCITY:
            return commanded[1:]
        return np.diff(commanded, axis=0) / self.period


@pytest.fixture(params=PROFILES)
def run(request: pytest.FixtureRequest) -> Run:
    return Run(made(request.param))


def first(values: dict[str, float]) -> float:
    return next(iter(values.values()))


def test_nothing_moves_without_a_key(run: Run) -> None:
    assert np.ptp(run.way(run.go(0.5)), axis=0).max() == 0.0
    assert run.states <= {State.READY, State.HOMING, State.ACTIVE}


def test_it_begins_where_the_limb_is() -> None:
    run = Run(made("ur-jog", "devices.arm.interface=position", *UR_POSITION))
    assert run.subset.actuator.command.kind is Kind.POSITION
    assert run.subset.actuator.measured is not None
    np.testing.assert_allclose(run.go(0.5)[-1], run.subset.actuator.measured.ravel(), atol=0.02)
    assert np.abs(run.subset.actuator.measured).max() > 1.0  # which isn't zero


UR_POSITION = (
    "guard={arm.position_command: {velocity: 0.3, acceleration: 1.0, jerk: 20.0}}",
    "stop={arm: hold}",
    "faults={bus-loss: hold}",
)


@pytest.mark.parametrize("data", [RIGHT, LEFT])
def test_a_tap_moves_one_joint_by_its_time_and_speed_at_most(run: Run, data: bytes) -> None:
    run.type(RIGHT)
    run.go(0.6)  # away from a hand's open end
    run.type(data)
    commanded = run.go(0.6)
    way, most = run.way(commanded) * (1 if data == RIGHT else -1), HOLD * first(run.subset.speed)
    assert 0.3 * most < way[-1, 0] <= most + first(run.subset.speed) * run.period
    assert way[:, 0].min() >= 0.0
    assert not np.ptp(commanded[:, 1:], axis=0).any()
    assert not run.speeds(commanded)[-10:].any()


def test_a_held_key_moves_at_the_speed_and_its_end_brakes(run: Run) -> None:
    started, speed = run.now, first(run.subset.speed)
    last = run.held(RIGHT, 1.2)
    commanded = run.go(1.9)
    times, found = started + run.period * np.arange(2, len(commanded) + 1), run.speeds(commanded)[:, 0]
    assert found.max() <= speed * 1.001
    even = (times > started + 0.9) & (times < last)
    np.testing.assert_allclose(found[even], speed, rtol=1e-3)
    slower = times[(times > last) & (found < 0.999 * speed)][0]
    assert slower - last <= 0.15
    law = run.subset.profile.controllers[0].options
    stands = speed / first(law["acceleration"]) + 3 * run.period
    assert not found[times > slower + stands].any()
    between = (times > started + 0.45) & (times < started + 0.5)
    if first(law["acceleration"]) > 1.0:
        assert not found[between].any()  # a console's first repeat comes late: until then it was a tap


def test_the_guards_bounds_hold() -> None:
    bounds = ("guard.finger.position_command.lower=-0.005", "guard.finger.position_command.upper=0.008")
    run = Run(made("servo-jog", *bounds))
    run.held(RIGHT, 0.7)
    up = run.go(0.9)
    assert 0.0079 < up[:, 0].max() <= 0.008
    run.held(LEFT, 0.7)
    down = run.go(0.9)
    assert -0.005 <= down[:, 0].min() < -0.0049
    turned = np.flatnonzero(np.diff(down[:, 0]) < 0.0)[0]
    assert turned * run.period < 0.1  # nothing was wound up at the bound


def test_the_other_way_and_another_joint_brake_first() -> None:
    run = Run(made("servo-jog"))
    run.held(RIGHT, 0.8)
    run.go(0.8)
    run.type(b"2")
    commanded = run.go(0.5)
    assert np.ptp(commanded[:, 0]) < 0.1 * 0.1
    run.type(LEFT)
    commanded = run.go(0.5)
    assert not np.ptp(commanded[:, 0])
    assert run.way(commanded)[-1, 1] < -0.005


def test_a_step_moves_once_while_the_key_is_held() -> None:
    run = Run(made("servo-jog"), step=True)
    run.held(RIGHT, 1.0)
    assert run.way(run.go(1.2))[-1, 0] == pytest.approx(HOLD * 0.1, rel=0.1)


def test_a_terminal_that_falls_silent_brakes_and_then_stops_the_limb() -> None:
    run = Run(made("servo-jog"))
    run.held(RIGHT, 0.8)
    run.go(0.8)
    found = []
    for _ in range(100):  # nobody writes the setpoints any more: they stay as they were
        run.lockstep.step()
        found.append(float(run.subset.actuator.applied[0]))
    assert np.ptp(found[20:]) == 0.0
    assert run.lockstep.cycle.machine.state is State.STOPPED


@pytest.mark.slow
def test_a_stop_holds_whatever_is_pressed_and_a_reset_moves_nothing() -> None:
    run = Run(made("servo-jog"))
    run.held(RIGHT, 5.0)
    run.go(0.7)
    run.lockstep.step(RequestKind.STOP)
    run.go(0.1)
    assert np.ptp(run.go(0.3), axis=0).max() == 0.0
    run.lockstep.step(RequestKind.RESET)
    assert np.ptp(run.go(3.0), axis=0).max() < 0.01  # it begins at the measured place, and the key is still held
    assert run.lockstep.cycle.machine.state is State.ACTIVE


@pytest.mark.slow
def test_a_key_that_is_pressed_just_before_a_reset_moves_nothing_while_it_is_held() -> None:
    """Its first repeat comes half a second later: that isn't a new press."""
    run = Run(made("servo-jog"))
    run.lockstep.step(RequestKind.STOP)
    run.go(0.1)
    run.held(RIGHT, 3.0)
    run.go(0.1)
    run.lockstep.step(RequestKind.RESET)
    assert np.ptp(run.go(2.5), axis=0).max() < 0.01
    assert run.lockstep.cycle.machine.state is State.ACTIVE


def test_no_joint_goes_on_for_long_and_no_slow_loop_times_a_press() -> None:
    fast = made("ur-jog", *(f"guard.arm.velocity_command.{k}" for k in ("acceleration=0.2", "velocity=1.0")), speed=0.5)
    assert max(fast.speed.values()) <= 0.2 * 0.3 * 1.001
    with pytest.raises(SrlError, match="at 10 Hz a key's press can't be timed"):
        made("servo-jog", "rate=10")


def test_the_guard_and_the_stop_are_the_profiles() -> None:
    for name, device in (("kairos-man", "arm"), ("kairos-man", "base"), ("strap-jog", None)):
        whole, _ = profile.load(name)
        found = made(name, device=device).profile
        (command,) = found.guard
        assert found.guard[command] == whole.guard[command]
        owner = command.partition(".")[0]
        assert (found.stop[owner], found.faults, found.rate) == (whole.stop[owner], whole.faults, whole.rate)
        assert [entry.use for entry in found.controllers] == ["jog"]
        assert list(found.devices) == [owner]


def test_no_stop_sends_the_limb_home() -> None:
    homes = [f"devices.finger.motors.{name}.home=0.5" for name in ("proximal", "distal")]
    switch = "emergency=[{signal: panel.buttons, element: red, category: retract}]"
    given = (*homes, BUTTONS, switch, "stop.finger=retract", "faults={bus-loss: retract, intent-loss: retract}")
    whole = profile.load("servo-jog", given)
    found = subset(*whole, None, 0.1, None).profile
    assert whole[0].stop["finger"] is Stop.RETRACT
    assert found.stop["finger"] is Stop.HOLD
    assert (found.faults.bus_loss, found.faults.intent_loss) == ("stop", "stop")
    assert found.emergency[0].category == "stop"


def test_sliding_joints_move_at_a_fifth_and_none_faster_than_the_guard() -> None:
    assert made("base-jog", speed=0.5).speed == pytest.approx({"vx": 0.09, "vy": 0.09, "wz": 0.12})
    assert made("strap-jog").speed["j5"] == pytest.approx(0.02)
    assert made("ur-jog", speed=0.5).speed["elbow"] == 0.3


BUTTONS = "devices.panel={driver: firmata, port: /dev/ttyACM1, buttons: {red: {pin: 2}}}"


def test_emergency_inputs_stay_with_devices_that_only_measure() -> None:
    switch = "emergency=[{signal: panel.buttons, element: red}, {signal: client.position, element: distal}]"
    found = subset(*profile.load("servo-jog", (BUTTONS, switch)), None, 0.1, None)
    assert set(found.profile.devices) == {"finger", "panel"}
    assert [entry.signal for entry in found.profile.emergency] == ["panel.buttons"]
    assert found.left_out == ("client.position",)


@pytest.mark.parametrize(
    ("given", "device", "speed", "words"),
    [
        ("servo-jog", "fingre", 0.1, "the profile has no device 'fingre'. Did you mean 'finger'"),
        ("kairos-man", "panel", 0.1, "takes no commands. Name one that moves: arm, base, hand"),
        ("kairos-man", None, 0.1, "3 of its devices take commands. Name one: arm, base, hand"),
        ("suit-station", None, 0.1, "none of its devices takes commands"),
        ("moca-man", "arm", 0.1, "'torque_command', neither a position nor a velocity"),
        ("human-srl", "arm", 0.1, "--set guard.arm.position_command.clear=null"),
        ("servo-jog", None, 0.51, "--speed: 0.51 rad/s is out of bounds. Give more than 0 and at most 0.5"),
        ("servo-jog", None, 0.0, "--speed: 0 rad/s is out of bounds"),
        ("servo-jog", None, float("nan"), "--speed: nan rad/s is out of bounds"),
    ],
)
def test_what_cant_be_jogged_is_refused(given: str, device: str | None, speed: float, words: str) -> None:
    with pytest.raises(SrlError) as error:
        made(given, speed=speed, device=device)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["servo-jog", "--speed", "0.6"], "--speed: 0.6 rad/s is out of bounds"),
        (["servo-jog", "--instance", "A b"], "'A b' is no name"),
        (["nothing"], "no profile has this name"),
        (["human-srl", "arm", "--sim"], "clear=null"),
    ],
)
def test_the_command_says_what_is_wrong(arguments: Sequence[str], words: str) -> None:
    assert words in refused("jog", *arguments)


def test_without_a_terminal_it_doesnt_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", None)
    assert "standard input is no terminal" in refused("jog", "servo-jog", "--sim")


@pytest.mark.parametrize(
    ("sim", "here", "real"),
    [(None, None, True), ([], [], False), (["finger"], ["finger"], False), (["glove"], None, True)],
)
def test_named_devices_alone_are_simulated(sim: list[str] | None, here: list[str] | None, real: bool) -> None:
    found = subset(*profile.load("sixth-finger"), "finger", 0.1, sim)
    assert (found.sim, found.real) == (here, real)


def test_a_simulated_device_that_isnt_there_is_named() -> None:
    with pytest.raises(SrlError, match=r"--sim fingr.*'fingr'.*Did you mean 'finger'"):
        subset(*profile.load("sixth-finger"), "finger", 0.1, ["fingr"])
