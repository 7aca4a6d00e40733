"""Where bending leads nowhere, a planned way goes back to the path's place, within the joints' limits and clear."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.operation import ACCELERATION, DT, LOWER, SPEED, UPPER, cycle, law, posture, press, teach

from srl.control.operation.demonstration import TaskPath
from srl.control.operation.detour import Detour
from srl.control.operation.law import IndependentOperation, Mode
from srl.control.operation.replay import Replay, ReplayOptions
from srl.control.operation.worn import Worn
from srl.control.reach.options import MarginOptions
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import ArmsModel

ARMS = ArmsModel(base=(-0.10, 0.05, 0.30))
LABELS = [f"J{i}" for i in range(1, 8)]
KEEP = 0.03
OPTIONS = MarginOptions(
    arms=ARMS,
    uncertainty=0.0,
    lower=dict(zip(LABELS, LOWER.tolist(), strict=True)),
    upper=dict(zip(LABELS, UPPER.tolist(), strict=True)),
    velocity=dict(zip(LABELS, SPEED.tolist(), strict=True)),
    acceleration=dict(zip(LABELS, ACCELERATION.tolist(), strict=True)),
)


class Scene:
    """An arm that obeys beside a wearer in the T-pose, and a task whose first place is somewhere else."""

    def __init__(self, start: Array, place: Array, planned: bool) -> None:
        options = EnvelopeOptions(arms=ARMS)
        self.worn = Worn(options.figure, options.arm, options.envelope)
        self.rotation, self.translation = posture()
        path = TaskPath(np.vstack([place, place + 1e-3]))
        self.replay = Replay(path, OPTIONS.ranges, ReplayOptions(keep=KEEP))
        self.detour = Detour(OPTIONS, self.worn, KEEP, 0.5) if planned else None
        self.q, self.v, self.planned = start.copy(), np.zeros(7), 0
        self.nearest = np.inf

    def cycle(self) -> None:
        self.rotation[0, 1] += 1e-12  # a real suit's samples differ
        self.worn.see(self.rotation, self.translation, DT)
        tip, J = self.worn.tip(self.q)
        pairs = self.worn.pairs(0.25, 12)
        self.nearest = min(self.nearest, float(pairs.distance.min(initial=1.0)))
        v = None
        if self.detour is not None:
            self.detour.see(self.rotation, self.translation, DT)
            v = self.detour.step(self.q, self.v, self.replay, DT)
        if v is None:
            v = self.replay.step(self.q, self.v, tip, J, tip, pairs, DT)
        else:
            self.planned += 1
            self.replay.hold(tip)
        assert (np.abs(v) <= SPEED + 1e-9).all()
        assert (np.abs(v - self.v) <= ACCELERATION * DT + 1e-9).all()
        self.v = v
        self.q = self.q + v * DT

    def goes(self, seconds: float) -> bool:
        """Whether the tip gets to the place."""
        for _ in range(round(seconds / DT)):
            self.cycle()
            if self.replay.done:
                return True
        return False


def tip(q: Array) -> Array:
    return Scene(q, np.zeros(3), False).worn.tip(q)[0].copy()


def drawn(number: int) -> tuple[Array, Array]:
    """Two postures beside the wearer that have 4 cm of margin each."""
    rng = np.random.default_rng(0)
    pairs = [rng.uniform(LOWER, UPPER, (2, 7)) for _ in range(number + 1)]
    return pairs[-1][0], pairs[-1][1]


@pytest.mark.parametrize("number", [0, 10, 43])  # in 10 the body is in the way, in the others the joints' limits are
def test_a_planned_way_leads_where_bending_stands(number: int) -> None:
    start, goal = drawn(number)
    place = tip(goal)
    assert not Scene(start, place, planned=False).goes(12.0)
    scene = Scene(start, place, planned=True)
    assert scene.goes(25.0)
    assert scene.planned > 50
    assert scene.nearest >= KEEP - 1e-9


def test_nothing_is_planned_where_the_task_goes_on() -> None:
    start, goal = drawn(0)
    scene = Scene(goal + 0.02 * (start - goal), tip(goal), planned=True)
    assert scene.goes(8.0)
    assert scene.planned == 0


def test_a_way_that_the_wearer_steps_into_is_left() -> None:
    start, goal = drawn(10)
    scene = Scene(start, tip(goal), planned=True)
    while not scene.planned:
        scene.cycle()
    way = scene.detour
    assert way is not None
    assert way.on
    rest = way._rest.margins
    way._rest.margins = lambda path: rest(path) - 1.0  # type: ignore[method-assign]
    scene.cycle()
    assert not way.on
    way._rest.margins = rest  # type: ignore[method-assign]
    assert scene.goes(25.0)


SHIFT = (-0.15, -0.3, 0.12)  # from the stretched hand's path to where the arm has room


def started(number: int, around: str) -> IndependentOperation:
    """The law in one of forty random postures; its task is pressed on."""
    rng = np.random.default_rng(0)
    q = [rng.uniform(LOWER, UPPER) for _ in range(number + 1)][-1]
    made = law(shift=SHIFT, replay={"keep": 0.02, "around": around, "plan_after": 0.5})
    teach(made)
    made.applied["q"][:] = made.input["position"][:] = q
    made.reset()
    press(made)
    return made


def seen(made: IndependentOperation) -> Mode:
    """One cycle of a suit whose samples differ; the state."""
    made.input["rotation"][0, 1] += 1e-12
    cycle(made)
    return Mode(int(made.output["state"][0]))


@pytest.mark.parametrize("number", [3, 24])  # in 3 the path begins where bending leads, and can't be ended so
def test_a_task_is_done_from_where_bending_never_does_it(number: int) -> None:
    bending = started(number, "bend")
    assert Mode.DONE not in {seen(bending) for _ in range(1500)}
    made, modes = started(number, "plan"), set[Mode]()
    for _ in range(3000):
        modes.add(seen(made))
        if Mode.DONE in modes:
            break
    assert {Mode.AROUND, Mode.GOING, Mode.DONE} <= modes


def test_who_holds_the_arm_is_not_led_round() -> None:
    made = started(24, "plan")
    held = made.input["position"] + 0.3
    for _ in range(600):
        made.input["position"][:] = held
        made.input["rotation"][0, 1] += 1e-12
        made.update(DT)
        assert made.output["state"][0] != Mode.AROUND
        made.applied["q"][:] = made.output["q"]


def test_a_press_ends_the_way_and_the_next_goes_on() -> None:
    made = started(24, "plan")
    while seen(made) is not Mode.AROUND:
        pass
    press(made)
    for _ in range(60):
        assert seen(made) is Mode.PAUSED
    assert (made.output["q_velocity"] == 0.0).all()
    press(made)
    while seen(made) is not Mode.DONE:
        pass


def test_a_task_that_goes_well_is_repeated_without_a_way() -> None:
    made = law(shift=SHIFT, replay={"keep": 0.02, "around": "plan", "plan_after": 0.5}, repeats=3)
    teach(made)
    press(made)
    modes = set[Mode]()
    while made.metrics()["done"] < 3:
        modes.add(seen(made))
    assert Mode.AROUND not in modes


def test_a_reset_ends_the_way() -> None:
    made = started(24, "plan")
    while seen(made) is not Mode.AROUND:
        pass
    made.applied["q"][:] = made.input["position"][:] = made.output["q"]
    made.reset()
    press(made)
    assert seen(made) is not Mode.AROUND
