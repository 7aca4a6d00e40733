"""The law `independent-operation`: a worn arm repeats, by itself, a task that the wearer's hand has shown."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np

from srl.control.operation.demonstration import TaskError, TaskPath
from srl.control.operation.detour import Detour
from srl.control.operation.options import IndependentOperationConfig
from srl.control.operation.reach import MOST, Reach
from srl.control.operation.record import TaskRecord
from srl.control.operation.replay import Replay
from srl.control.operation.tally import Tally
from srl.control.operation.teaching import Teaching
from srl.control.operation.triggers import Triggers
from srl.control.operation.worn import Worn
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

_UNIT: Final = 0.1  # a quaternion whose squared length is off by more is none
_OBEYED: Final = 0.1  # of what a joint moves in a cycle at full speed: nearer than that, a command was obeyed
_WAITS, _GOES = 0.05, 0.2  # the phase's rates below and above which the task waits, and goes on


class Mode(IntEnum):
    """What the output `state` says."""

    NO_TASK = 0
    PAUSED = 1
    GOING = 2
    WAITING = 3
    DONE = 4
    TEACHING = 5
    CHECKING = 6
    AROUND = 7


class IndependentOperation(Controller):
    """Repeats a task on a phase that waits, bent around the moving body (`srl.control.operation.replay`).

    All is computed in the frame of the node that carries the arms: the wearer may walk and turn. That frame is taken
    for rigid with the arm's base.

    Inputs: `rotation` (59, 4), `translation` (59, 3) m, the suit's joints in their parents; `position` (n,) rad (m
    where a joint slides), measured; `press` (1,), a level or a count that rises by one a press; `action` (2,), the two
    named actions of `intention:`; `teach` (1,), 1 while the hand shows a task. The last three as the options say.

    Outputs: `q` (n,), `q_velocity` (n,); `state` (1,), a `Mode`; `phase` (1,) s; `pace` (1,), the phase's rate;
    `error` (1,) m, of the measured tip from the path's place; `distance` (1,) m, of the nearest pair of body and arm,
    at most `replay.look`; `target` (1, 3) m, the path's place in the suit's world.

    A reset pauses the task and keeps its phase. It is resumed by a press or an action, and the tip goes back to the
    path at a limited speed. Where the body, the position or a button isn't finite the arm brakes on its way and the
    task pauses; after `timeout` they are lost.
    """

    Config = IndependentOperationConfig
    summary = "a worn arm repeats a task that the wearer's hand has shown, around the moving body"

    def __init__(self, name: str, config: IndependentOperationConfig) -> None:
        super().__init__(name, config)
        self._options = o = config
        figure, labels = o.figure, o.arms.arms.labels
        n, k = len(labels), len(figure.labels)
        self.inputs = (
            Signal(name="rotation", shape=(k, 4), unit="1", labels=figure.labels, components=(QUATERNION,)),
            Signal(name="translation", shape=(k, 3), unit="m", labels=figure.labels, components=(POINT,)),
            Signal(name="position", shape=(n,), unit="rad", labels=labels, slides=o.arms.arms.slides),
        )
        if o.button:
            self.inputs += (Signal(name="press", shape=(1,), unit="1"),)
        if o.intention is not None:
            names = (o.intention.run, o.intention.pause)
            self.inputs += (Signal(name="action", shape=(2,), unit="1", labels=names),)
        if o.teach:
            self.inputs += (Signal(name="teach", shape=(1,), unit="1"),)
        self.outputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=labels, slides=o.arms.arms.slides),
            Signal(name="q_velocity", shape=(n,), unit="rad/s", labels=labels),
            Signal(name="state", shape=(1,), unit="1"),
            Signal(name="phase", shape=(1,), unit="s"),
            Signal(name="pace", shape=(1,), unit="1"),
            Signal(name="error", shape=(1,), unit="m"),
            Signal(name="distance", shape=(1,), unit="m"),
            Signal(
                name="target", shape=(1, 3), unit="m", frame=o.frame, labels=("target",), components=(POINT,),
                visual="points",
            ),
        )  # fmt: skip
        self._worn = Worn(figure, o.arm, o.envelope)
        self._shift = np.array(o.shift)
        self._teaching = Teaching(self._worn, o.ranges, o.thresholds, self._shift)
        self._triggers, self._tally = Triggers(), Tally()
        self._detour = Detour(o, self._worn, o.replay.keep, o.replay.plan_after) if o.replay.around == "plan" else None
        self._replay = None if o.shown is None else self._task(self._kept(o.shown))
        self._last: Array = np.zeros(n)  # what was applied in the cycle before
        self._running, self._joined = False, False
        self._fresh = True  # the next sample of the body is the first
        self._left, self._missed = 0, 0.0
        self._waits = False

    def _kept(self, shown: TaskRecord) -> TaskPath:
        """The path of the file. Raises ProfileError: the arm can't follow it."""
        path, ranges = TaskPath(shown.path.points + self._shift), self._options.ranges
        try:
            Reach(path, self._worn, ranges, ranges.posture).step(MOST * len(path.points))
        except TaskError as error:
            raise ProfileError(f"controllers.{self.name}.task", error.problem, error.remedy) from None
        return path

    def _task(self, path: TaskPath) -> Replay:
        return Replay(path, self._options.ranges, self._options.replay)

    def reset(self) -> None:
        q = self.output["q"]
        q[:] = self.applied.get("q", q)
        self._last[:] = q
        self.output["q_velocity"][:] = 0.0
        self.lost, self._missed, self._fresh, self._running = False, 0.0, True, False
        self._triggers.forget()
        self._triggers.read(self.input)
        self._teaching.drop("the run was interrupted")
        self._drop_way()
        if self._replay is not None:
            self._replay.r = 0.0
        self._tell()

    def update(self, dt: float) -> None:
        q = self._last + 0.0
        q[:] = self.applied.get("q", self.output["q"])
        before = (q - self._last) / dt
        self._last[:] = q
        good = self._sees()
        self._missed = 0.0 if good else self._missed + dt
        self.lost = self._missed > self._options.timeout
        if not good:
            self._fresh, self._running = True, False
            self._drop_way()
            self._teaching.drop("the body, a button or the arm's position wasn't there")
            self._command(q, self._brake(before, dt), dt)
            return
        since = 0.0 if self._fresh else dt
        self._worn.see(self.input["rotation"], self.input["translation"], since)
        if self._detour is not None:
            self._detour.see(self.input["rotation"], self.input["translation"], since)
        self._fresh = False
        self._obey(q, dt)
        if self._running and self._replay is not None:
            obeyed = bool((np.abs(q - self.output["q"]) <= _OBEYED * self._options.ranges.dq_max * dt).all())
            v = self._go(self._replay, q, before, obeyed, dt)
        else:
            v = self._brake(before, dt)
            self._drop_way()
        self._command(q, v, dt)
        path = self._teaching.check()
        if path is not None:
            self._replay, self._running = self._task(path), False
            self._tally.taught += 1
            self._tell()

    def metrics(self) -> dict[str, object]:
        """Returns the figures of `srl.control.operation.tally`, and why the last demonstration was refused."""
        shown = self._options.shown
        whose = {} if shown is None else {"person": shown.person, "simulated": shown.simulated}
        return {**whose, **self._tally.metrics(), "refused": self._teaching.refused or None}

    # -- parts of an update

    def _sees(self) -> bool:
        """Whether all inputs are there; takes the triggers."""
        rotation, good = self.input["rotation"], self._triggers.read(self.input)
        if self._options.teach:
            good = good and bool(np.isfinite(self.input["teach"]).all())
        good = good and all(np.isfinite(self.input[name]).all() for name in ("translation", "position"))
        # False also where a rotation isn't finite.
        return good and bool((np.abs((rotation * rotation).sum(axis=1) - 1.0) < _UNIT).all())

    def _obey(self, q: Array, dt: float) -> None:
        """Does what the person asks: teach, run, pause."""
        t, teaching = self._triggers, self._teaching
        if self._options.teach:
            shows = float(self.input["teach"][0]) > 0.5
            if shows and not teaching.on:
                teaching.begin()
            elif teaching.on and not shows:
                teaching.end(q)
            if shows:
                teaching.sample(self._worn.place(self._options.hand), dt)
        busy = teaching.on or teaching.checking
        if self._running and (t.toggle or t.pause or busy):
            self._running = False
            self._tally.pauses += 1
        elif not self._running and (t.toggle or t.run) and not busy and self._replay is not None:
            self._running = True
            if self._replay.done:
                self._replay.again()
            if self._replay.s == 0.0:
                self._left, self._joined = self._options.repeats or 0, False

    def _go(self, replay: Replay, q: Array, before: Array, obeyed: bool, dt: float) -> Array:
        """The velocity (n,) along the task. `obeyed`: the guard let the last command through."""
        o = self._options.replay
        measured = self._worn.tip(self.input["position"])[0].copy()
        tip, J = self._worn.tip(q)
        pairs = self._worn.pairs(o.look, o.pairs)
        v = self._around(replay, q, before, tip, measured, dt)
        if v is None:
            v = replay.step(q, before, tip, J, measured, pairs, dt)
        error = float(np.linalg.norm(replay.path.at(replay.s)[0] - measured))
        near = float(pairs.distance.min(initial=o.look))
        self._joined = self._joined or replay.error <= o.slow
        if not replay.blocked and obeyed:
            replay.correct(measured, dt)
        self._waits = replay.r < (_GOES if self._waits else _WAITS)
        if self._joined:
            self._tally.add(error, near, dt, self._waits, replay.blocked)
        self.output["error"][0], self.output["distance"][0] = error, near
        if replay.done:
            self._tally.done += 1
            self._left -= 1
            if self._options.repeats is None or self._left > 0:
                replay.again()
                self._joined = False
            else:
                self._running = False
        return v

    def _around(self, replay: Replay, q: Array, before: Array, tip: Array, measured: Array, dt: float) -> Array | None:
        """The velocity (n,) on a way that was planned; None: there is none, or none is needed."""
        detour = self._detour
        if detour is None:
            return None
        if float(np.linalg.norm(measured - tip)) > self._options.replay.wait:
            detour.drop()  # something holds the arm
            return None
        v = detour.step(q, before, replay, dt)
        if v is not None:
            replay.hold(tip)
        return v

    def _drop_way(self) -> None:
        if self._detour is not None:
            self._detour.drop()

    def _brake(self, before: Array, dt: float) -> Array:
        """The velocity (n,) that brakes all joints together, so that the tip stays on its way."""
        if self._replay is not None:
            self._replay.r = 0.0
        step = self._options.ranges.ddq_max * dt
        cycles = float((np.abs(before) / step).max())
        return before * (1.0 - 1.0 / cycles) if cycles > 1.0 else 0.0 * before

    def _command(self, q: Array, v: Array, dt: float) -> None:
        self.output["q_velocity"][:] = v
        self.output["q"][:] = q + v * dt
        self._tell()

    def _tell(self) -> None:
        """Fills what says how the task stands."""
        replay, out = self._replay, self.output
        out["state"][0] = self._mode()
        if replay is not None:
            out["phase"][0], out["pace"][0] = replay.s, replay.r
            out["target"][0] = self._worn.in_world(replay.path.at(replay.s)[0])

    def _mode(self) -> Mode:
        replay = self._replay
        if self._teaching.on:
            return Mode.TEACHING
        if self._teaching.checking:
            return Mode.CHECKING
        if replay is None:
            return Mode.NO_TASK
        if self._running:
            if self._detour is not None and self._detour.on:
                return Mode.AROUND
            return Mode.WAITING if self._waits else Mode.GOING
        return Mode.DONE if replay.done else Mode.PAUSED
