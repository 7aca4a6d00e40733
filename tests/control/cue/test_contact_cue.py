"""What the limb touches becomes what its wearer feels: threshold, tap, strength, release; and as one whole run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.cue.contact_cue import ContactCue, ContactCueConfig
from srl.control.cue.state_cue import StateCue, StateCueConfig
from srl.runtime.contracts.cue import Cue
from srl.sim.devices.vibration_motors.fake import FakeVibrationMotors
from srl.testing import ControllerConformance, Lab, bound

DT = 0.01
OPTIONS: dict[str, Any] = {"labels": ("x", "y"), "motors": ("wrist",), "threshold": 1.0, "full": 5.0, "least": 0.2}
EACH: dict[str, Any] = OPTIONS | {"combine": "each", "motors": ("left", "right")}


def law(**options: Any) -> ContactCue:
    made = bound(ContactCue("touch", ContactCueConfig(**(OPTIONS | options))))
    made.reset()
    return made


def step(made: ContactCue, *load: float) -> list[float]:
    made.input["load"][:] = load
    made.update(DT)
    return [float(value) for value in made.output["intensity"]]


class TestContactCue(ControllerConformance):
    inputs, start = {"load": [3.0, -2.0]}, {"intensity": [0.0]}

    def law(self) -> ContactCue:
        return bound(ContactCue("touch", ContactCueConfig(**(OPTIONS | {"tap": 0.0, "threshold": 4.0}))))


class TestStateCue(ControllerConformance):
    inputs, start = {}, {"intensity": [0.0]}

    def law(self) -> StateCue:
        return bound(
            StateCue(
                "state",
                StateCueConfig(motors=("wrist",), begin=Cue.model_construct(pulses=1, on=0.1, off=0.15, level=1e-9)),
            )
        )


def test_a_contact_begins_with_a_tap_then_tells_its_strength_and_ends_below_the_threshold() -> None:
    made = law()
    assert step(made, 0.9, 0.0) == [0.0]
    taps = [step(made, 3.0, 4.0)[0] for _ in range(10)]  # |x| = 5
    assert taps == [1.0] * 10
    assert step(made, 3.0, 0.0) == [pytest.approx(0.2 + 0.8 * 0.5)]
    assert step(made, 0.0, -9.0) == [1.0]
    assert step(made, 0.9, 0.0) == [pytest.approx(0.2)]  # still the same contact
    assert step(made, 0.7, 0.0) == [0.0]
    assert step(made, 0.9, 0.0) == [0.0]  # and it begins at the threshold again
    assert step(made, 1.0, 0.0) == [1.0]


def test_each_element_has_its_own_motor() -> None:
    made = law(**EACH)
    assert step(made, -3.0, 0.0) == [1.0, 0.0]
    for _ in range(10):
        step(made, -3.0, 0.0)
    assert step(made, -3.0, 2.0) == [pytest.approx(0.6), 1.0]


@given(st.lists(st.floats(-1e9, 1e9) | st.sampled_from([np.nan, np.inf, -np.inf]), min_size=1, max_size=60))
def test_it_is_from_0_to_1_whatever_comes_and_what_was_never_known_is_0(loads: list[float]) -> None:
    made = law(**EACH)
    for load in loads:
        left, right = step(made, load, 0.0)
        assert 0.0 <= left <= 1.0
        assert right == 0.0
        assert not np.isinf(load) or left == 1.0


def test_the_magnitude_is_that_of_what_is_known_and_an_infinite_load_is_a_full_one() -> None:
    made = law(tap=0.0)
    assert step(made, np.nan, 3.0) == [pytest.approx(0.2 + 0.8 * 0.5)]
    assert step(made, np.nan, np.nan) == [pytest.approx(0.2 + 0.8 * 0.5)]  # as it was
    assert step(made, np.inf, np.nan) == [1.0]
    assert step(made, -np.inf, 0.0) == [1.0]


def test_a_load_that_stays_unknown_is_a_loss_until_a_reset() -> None:
    made = law()
    for _ in range(49):
        step(made, np.nan, 0.0)
    assert not made.lost
    for _ in range(200):
        step(made, 0.0, 0.0)  # it is there again
    assert not made.lost
    for _ in range(52):
        step(made, 0.0, np.nan)
    assert made.lost
    made.reset()
    assert not made.lost
    patient = law(max_hold=np.inf)
    for _ in range(500):
        step(patient, np.nan, np.nan)
    assert not patient.lost


@pytest.mark.parametrize("every", [2, 3, 5, 10, 50])
def test_a_load_that_is_known_now_and_then_is_a_loss_too(every: int) -> None:
    made = law()
    for k in range(500):
        step(made, *([10.0, 0.0] if k % every == 0 else [np.nan, np.nan]))
    assert made.lost


def test_a_cue_is_given_as_the_limb_begins_to_follow() -> None:
    made = law(begin=Cue(pulses=2, on=0.1, off=0.2, level=0.5))
    levels = [step(made, 0.0, 0.0)[0] for _ in range(60)]
    assert [i for i in range(1, 60) if levels[i] > levels[i - 1]] == [30]
    assert (levels[0], max(levels), levels[-1]) == (0.5, 0.5, 0.0)


def test_a_cue_that_is_too_short_for_the_cycles_gives_a_warning() -> None:
    made = law(begin=Cue(on=0.1))
    assert not list(made.warnings(0.05))
    assert list(made.warnings(0.06)) == [("begin", "a pulse or pause of 0.1 s is less than two cycles of 0.06 s")]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"combine": "each"}, "1 motors for 2 elements"),
        ({"full": 1.0}, "isn't above the threshold"),
        ({"labels": ("x", "x")}, "more than once"),
        ({"threshold": 0.0}, "greater than 0"),
    ],
)
def test_options_that_cant_be_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ContactCueConfig(**(OPTIONS | options))


CUFF = ["feedback=cuff", "sim.devices.toes.period=2.0"]


@pytest.fixture
def lab() -> Any:
    with Lab("third-thumb", CUFF) as run:
        run.until("active")
        yield run


def test_the_wearer_feels_the_thumbs_contact_and_every_stop_is_off_but_for_its_cue(lab: Lab) -> None:
    lab.run(1.0)  # the cue of the begin
    lab.until("cuff.intensity_command", above=0.9, most=10.0)
    assert float(np.linalg.norm(lab["thumb.effort"])) > 0.07
    lab.run(0.2)
    lab.stop()
    lab.run(0.02)
    assert lab.state in ("stopping", "stopped")
    pulses, before = 0, 1.0
    for _ in range(200):
        lab.run(0.01)
        level = float(lab["cuff.intensity_command.applied"])
        pulses += level > 0.0 and before == 0.0
        before = level
    assert pulses <= 2
    assert before == 0.0
    lab.reset()
    lab.until("active")


def test_a_cuff_at_fault_is_switched_off(lab: Lab) -> None:
    """No command follows to a board that is stale or at fault, and it would go on with what it had."""
    lab.run(1.0)
    lab.until("cuff.intensity_command", above=0.9, most=10.0)
    (cuff,) = (device for device in lab._graph.devices if isinstance(device, FakeVibrationMotors))
    lab.run(0.05)
    lab.fault("cuff", "refusing")
    lab.until("stopped")
    lab.run(0.05)
    at = lab._graph.world.time if lab._graph.world is not None else 0
    before = cuff.felt[0].vibration(at)
    assert cuff.felt[0].vibration(at + 1_000_000_000) < 0.01 * max(before, 0.01)


def test_a_lost_cuff_stops_the_limb(lab: Lab) -> None:
    """Its wearer counts on what it tells."""
    lab.fault("cuff", "disconnected")
    lab.until("stopped")
    assert lab.cause == "device_loss"
