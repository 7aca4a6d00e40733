"""A profile on its fakes in the test's own process: its time, its faults, and what it says of what is wrong."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.somebody import environment, pytest_in

from srl.runtime.contracts.errors import DeviceError, ProfileError, RecordingError, RequestError
from srl.runtime.testing.faults import FAULTS
from srl.testing import Lab, simulate

FT = {
    "name": "sensor",
    "rate": 100,
    "devices": {"ft": {"driver": "ati-netft", "port": "udp://127.0.0.1:9"}},
    "sim": {"world": "cell", "parts": {"ft_sensor": {"part": "ft-sensor"}}, "devices": {"ft": {"noise": 0.01}}},
}


@pytest.fixture
def lab() -> Iterator[Lab]:
    with Lab("sixth-finger") as made:
        made.until("active")
        made.run(0.5)
        yield made


@pytest.fixture
def sensor() -> Iterator[Lab]:
    with Lab(FT) as made:
        made.run(0.5)
        yield made


# Profiles and time


def test_a_profile_is_a_name_a_path_a_text_or_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = json.dumps(FT, indent=1)
    (tmp_path / "ft.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    for given in (FT, text, tmp_path / "ft.yaml", "ft.yaml", Path("ft.yaml")):
        with Lab(given) as made:
            made.step(3)
            assert (made.cycles, made.time) == (3, pytest.approx(0.03))
    with pytest.raises(ProfileError, match="no profile has this name"):
        Lab("sixth-fingr")


def test_it_repeats_bit_for_bit_and_as_simulate_does() -> None:
    rows = []
    for _ in range(2):
        with Lab(FT) as made:
            made.run(0.3)
            rows.append(made.rows)
    assert rows[0].tobytes() == rows[1].tobytes() == simulate(FT, 0.3).rows.tobytes()


def test_overrides_are_those_of_set() -> None:
    with Lab(FT, ["rate=50"]) as made:
        made.run(1.0)
        assert made.cycles == 50


def test_nothing_is_left() -> None:
    """No thread, no process, no descriptor: there was none from the beginning."""
    with Lab("sixth-finger") as warm:  # what libraries keep for good, they open once
        warm.step()
    before = there()
    with Lab("sixth-finger") as made:
        made.run(0.2)
        assert there() <= before
    assert there() <= before
    made.close()
    with pytest.raises(RequestError, match="has ended"):
        made.step()
    assert made["glove.position"].shape == (22,)  # what has run stays readable


def there() -> set[str]:
    """Threads, processes and descriptors of this process. Those of other tests may end meanwhile."""
    processes = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    descriptors = [f"{name}: {os.readlink(path)}" for name in os.listdir("/proc/self/fd")
                   if os.path.lexists(path := f"/proc/self/fd/{name}")]  # fmt: skip
    return {*processes, *descriptors, *(str(thread.ident) for thread in threading.enumerate())}


def test_wrong_times_are_refused(sensor: Lab) -> None:
    for wrong in (
        lambda: sensor.step(-1),
        lambda: sensor.run(float("nan")),
        lambda: sensor.until("active", most=1e999),
    ):
        with pytest.raises(RequestError):
            wrong()


# Faults


def test_every_fault_ends_when_it_is_healed(sensor: Lab) -> None:
    for kind in set(FAULTS) - {"deaf", "refusing", "drifting", "misreporting"}:
        sensor.fault("ft", kind, by={"late": 0.2, "clock-jump": -5.0}.get(kind, 0.0))
        sensor.run(0.3)
        sensor.heal("ft")
        sensor.run(0.7)  # a device that was gone is opened again within half a second
        assert sensor.connected("ft")
        assert not sensor.stale("ft")
        sensor.check("ft.wrench")


def test_silent_grows_old_and_stays_connected(sensor: Lab) -> None:
    sensor.fault("ft", "silent")
    before = sensor["ft.wrench"]
    sensor.run(0.5)
    assert sensor.stale("ft")
    assert sensor.connected("ft")
    assert (sensor["ft.wrench"] == before).all()


def test_frozen_goes_on_with_the_same_values(sensor: Lab) -> None:
    sensor.fault("ft", "frozen")
    before = sensor["ft.wrench"]
    sensor.run(0.5)
    assert not sensor.stale("ft")
    assert (sensor.history("ft.wrench")[-40:] == before).all()


def test_nan_goes_on_without_values(sensor: Lab) -> None:
    sensor.fault("ft", "nan")
    sensor.run(0.5)
    assert not sensor.stale("ft")
    assert np.isnan(sensor["ft.wrench"]).all()


def test_late_shows_what_was_there_before_and_says_when() -> None:
    with Lab(FT) as good, Lab(FT) as late:
        good.run(1.0)
        late.run(0.2)
        late.fault("ft", "late", by=0.05)
        late.run(0.8)
        assert (late.history("ft.wrench")[30:] == good.history("ft.wrench")[25:-5]).all()
        stamps = [each.layout.header(each.rows, "ft.stamp") for each in (late, good)]
        assert (stamps[0][30:] == stamps[1][25:-5]).all()


def test_disconnected_is_lost_and_cant_be_opened_before_it_is_healed(sensor: Lab) -> None:
    sensor.fault("ft", "disconnected")
    sensor.run(2.0)
    assert not sensor.connected("ft")
    assert "it is gone" in sensor.events[0]
    sensor.heal("ft")
    sensor.until(lambda: sensor.connected("ft"), most=1.0)
    assert "back" in sensor.events[-1]


@pytest.mark.parametrize(
    ("device", "kind", "cause"),
    [
        ("glove", "silent", "intent_loss"),
        ("glove", "disconnected", "intent_loss"),
        ("finger", "disconnected", "device_loss"),
        ("finger", "refusing", "device_fault"),
    ],
)
def test_a_limb_stops_for_it_and_a_person_starts_it_again(lab: Lab, device: str, kind: str, cause: str) -> None:
    lab.fault(device, kind)
    lab.until("stopped", most=1.0)
    assert (lab.cause, lab.fault_source) == (cause, device)
    lab.reset()
    assert lab.state == "stopped"  # refused: the fault is there
    lab.heal(device)
    lab.run(1.0)
    assert lab.state == "stopped"  # nothing moves by itself
    lab.reset()
    lab.until("active", most=10.0)
    assert lab.cause == "none"


def test_a_deaf_device_is_sent_nothing(lab: Lab) -> None:
    before = lab["finger.position_command.sent"]
    lab.fault("finger", "deaf")
    lab.run(0.5)
    assert (lab["finger.position_command.sent"] == before).all()
    assert "isn't sent as applied" in lab.situation()


@pytest.mark.parametrize(
    ("device", "kind", "by", "words"),
    [
        ("gluve", "silent", 0.0, "Did you mean 'glove'"),
        ("glove", "sielnt", 0.0, "Did you mean 'silent'"),
        ("glove", "late", 0.0, "`by` is 0 s"),
        ("glove", "silent", 0.1, "with no other"),
        ("glove", "late", float("nan"), "`by` is nan s"),
        ("glove", "deaf", 0.0, "takes no commands"),
        ("finger", "nan", 0.0, "gives no samples"),
    ],
)
def test_a_fault_that_cant_be_is_refused(lab: Lab, device: str, kind: str, by: float, words: str) -> None:
    with pytest.raises(RequestError, match=words):
        lab.fault(device, kind, by)


def test_a_fake_that_cant_open_is_told() -> None:
    wrong = FT | {"sim": FT["sim"] | {"devices": {"ft": {"loss": [[0.0, 1.0]]}}}}  # type: ignore[operator]
    with pytest.raises(DeviceError, match="loss"):
        Lab(wrong)


# Clients

TARGET = [0.2, 0.6, 0.4, 0.4]  # rad


def test_a_clients_setpoint_is_followed_and_its_silence_stops() -> None:
    with Lab("finger-jog") as lab:
        lab.run(0.5)
        assert lab.state == "ready"  # it waits for its client
        lab.setpoint("client.position", 0.0)
        lab.until("active", most=1.0)
        lab.step()  # the laws begin in the cycle after
        lab.setpoint("client.position", TARGET)  # a new one: the law follows no target from before its reset
        lab.run(5.0)
        lab.check("finger.position_command.applied", near=TARGET, within=0.01)
        lab.setpoint("client.position", None)
        lab.until("stopped", most=2.0)
        assert (lab.cause, lab.fault_source) == ("intent_loss", "client")


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("client.positon", TARGET, r"Did you mean 'client\.position'"),
        ("client.position", [0.1, 0.2], r"shaped \(2,\)"),
        ("client.position", [0.1, 0.2, 0.3, float("nan")], "aren't finite"),
    ],
)
def test_a_setpoint_that_cant_be_is_refused(name: str, values: list[float], words: str) -> None:
    with Lab("finger-jog") as lab, pytest.raises(RequestError, match=words):
        lab.setpoint(name, values)


def test_a_parameter_is_changed_within_its_bounds(lab: Lab) -> None:
    lab.set("mapping.drift_pull", 1.5)
    lab.step()
    lab.check("mapping.drift_pull", near=1.5)
    for wrong in (1e9, float("nan")):
        with pytest.raises(RequestError, match="out of its bounds"):
            lab.set("mapping.drift_pull", wrong)
    with pytest.raises(RequestError, match="Did you mean"):
        lab.set("mapping.drift_pul", 1.0)


# What is said


def test_a_check_names_elements_units_and_the_situation(lab: Lab) -> None:
    applied = lab["finger.position_command.applied"]
    lab.check("finger.position_command.applied", near=applied, within=0.0)
    lab.check("finger.position_command.applied[flexion_1]", near=applied[1], within=1e-9)
    lab.check("glove.position", above=-3.2, below=3.2)
    lab.fault("glove", "frozen")
    wrong = [applied[0], applied[1] + 1, applied[2], applied[3]]
    with pytest.raises(AssertionError) as caught:
        lab.check("finger.position_command.applied", near=wrong, within=0.1)
    output = str(caught.value)
    assert "it is flexion_1" in output
    assert "abduction" not in output.partition("it is")[2]
    assert "± 0.1 rad" in output
    assert "state active, glove is frozen" in output


def test_a_value_that_isnt_finite_is_never_right(sensor: Lab) -> None:
    sensor.fault("ft", "nan")
    sensor.step()
    for expected in ({}, {"near": 0.0, "within": 1e9}, {"above": -1e9}, {"below": 1e9}):
        with pytest.raises(AssertionError, match="nan"):
            sensor.check("ft.wrench", **expected)  # type: ignore[arg-type]
    with pytest.raises(AssertionError, match="it is fx nan"):
        sensor.until("ft.wrench", above=-1e9, most=0.1)


def test_until_says_what_didnt_come(lab: Lab) -> None:
    with pytest.raises(AssertionError, match=r"not in 0.1 s: state 'stopped'\. After .* s: state active"):
        lab.until("stopped", most=0.1)
    with pytest.raises(AssertionError, match=r"above 9 rad; it is abduction"):
        lab.until("finger.position_command", above=9, most=0.1)
    before = lab.cycles
    lab.until("active")
    assert lab.cycles == before


def test_names_and_shapes_that_arent_there_are_told(lab: Lab) -> None:
    for what in (
        lambda: lab["glove.positon"],
        lambda: lab.check("glove.positon"),
        lambda: lab.history("glove.positon"),
    ):
        with pytest.raises(RequestError, match=r"Did you mean 'glove\.position'"):
            what()
    with pytest.raises(RecordingError, match="Known: index_dij"):
        lab.check("glove.position[little]")
    with pytest.raises(RequestError, match="it is no state"):
        lab.until("activ")
    with pytest.raises(RequestError, match="one for each element"):
        lab.check("finger.position_command", near=[1.0, 2.0])
    with pytest.raises(RequestError, match="NaN"):
        lab.until("glove.position", above=float("nan"))


# The plugin


def test_the_plugin_imports_nothing_heavy() -> None:
    code = (
        "import pytest, sys; known = set(sys.modules); import srl.runtime.testing.plugin;"
        "print(sorted(set(sys.modules) - known))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['srl', 'srl.runtime', 'srl.runtime.testing', 'srl.runtime.testing.plugin']"


@pytest.mark.slow
def test_the_public_face_needs_no_pytest() -> None:
    code = "import sys; sys.modules['pytest'] = None; import srl.testing"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_the_fixture_closes_what_a_test_began(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(
        "begun = []\n"
        "def test_fails(srl_run):\n"
        f"    begun.append(srl_run({FT!r}))\n"
        f"    begun.append(srl_run({FT!r}, 'rate=50'))\n"
        "    begun[0].run(0.1)\n"
        "    begun[0].check('ft.wrench', above=1e6)\n"
        "def test_closed():\n"
        "    assert all(each._closed for each in begun) and len(begun) == 2\n"
    )
    done = pytest_in(tmp_path, environment(tmp_path), "test_it.py")
    assert "1 failed, 1 passed" in done.stdout, done.stdout + done.stderr
    assert "ft.wrench should be above 1e+06 N" in done.stdout
