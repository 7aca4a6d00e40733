"""Programs that run on the twin's controller: URScript, with the motions that take time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from srl.drivers.ur.registers import CYCLE
from srl.sim.devices.ur.controller import UrController
from srl.sim.devices.ur.kinematics import placement, vector
from srl.sim.devices.ur.twin_expressions import Pose, ScriptError
from srl.sim.devices.ur.twin_functions import Refusals, functions, near_angles
from srl.sim.devices.ur.twin_registers import Registers
from srl.sim.devices.ur.twin_script import Script
from srl.sim.devices.ur.twin_statements import Thread, Wait

SERVO_GAIN: Final = 300.0
_LONGEST: Final = 3600.0  # s, longest duration of a motion that has an end
_KILLED: Final = 4.0  # rad/s^2, deceleration of a motion whose thread is killed: chosen


class UrScriptProgram:
    """A program in the small URScript.

    Attributes:
        name: the program's name.
        error: why it ended early.
        texts: what it said with textmsg and popup.
    """

    def __init__(self, text: str, controller: UrController, registers: Registers, refusals: Refusals) -> None:
        """Raises ScriptError: the text isn't a valid program."""
        self._controller, self._registers = controller, registers
        self.error = ""
        self.texts: list[str] = []
        self._moves: Thread | None = None  # the thread whose motion it is
        given = functions(controller, registers, refusals, self._say)
        self._script = Script(text, given, self._motions(), self._killed)
        self.name = self._script.name

    def cycle(self) -> bool:
        """Runs one control cycle; returns False once the program has ended or its watchdog has tripped."""
        if name := self._registers.bites():
            self.error = f"no input {name}: its watchdog stopped the program"
            return False
        try:
            return self._script.cycle()
        except ScriptError as error:
            self.error = str(error)
            return False

    def _say(self, *parts: Any) -> None:
        self.texts = [*self.texts[-99:], "".join(str(part) for part in parts)]

    def _killed(self, thread: Thread) -> None:
        if thread is self._moves and self._controller.motion.driven:
            self._controller.motion.stop(_KILLED)

    def _motions(self) -> dict[str, Callable[..., Wait]]:
        controller = self._controller
        motion = controller.motion

        def mine() -> None:
            self._moves = self._script.current

        def sync() -> Wait:
            yield

        def sleep(t: float) -> Wait:
            for _ in range(max(1, round(t / CYCLE))):
                yield

        def speedj(qd: list[float], a: float = 1.4, t: float = 0.0) -> Wait:
            mine()
            motion.speed(qd, a)
            yield from sleep(t) if t else settled(lambda: abs(motion.qd - qd).max() < 1e-6)

        def speedl(xd: list[float], a: float = 1.2, t: float = 0.0, aRot: float = 0.0) -> Wait:
            mine()
            motion.speed_tool(xd, a)

            def reached() -> bool:
                return bool(abs(controller.kinematics.jacobian(motion.q) @ motion.qd - xd).max() < 1e-4)

            yield from sleep(t) if t else settled(reached)

        def servoj(
            q: list[float], a: float = 0.0, v: float = 0.0, t: float = CYCLE, lookahead_time: float = 0.1,
            gain: float = SERVO_GAIN,
        ) -> Wait:  # fmt: skip
            mine()
            motion.servo(q, lookahead_time, gain)
            yield from sleep(t)

        def servoc(pose: list[float], a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Wait:
            mine()
            motion.move_tool(pose, a, v)
            yield

        def stopj(a: float) -> Wait:
            mine()
            motion.stop(a)
            yield from settled(lambda: motion.at_rest)

        def stopl(a: float, aRot: float = 0.0) -> Wait:
            mine()
            motion.stop_tool(a)
            yield from settled(lambda: motion.at_rest)

        def movej(q: Sequence[float], a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Wait:
            mine()
            goal = near_angles(controller, q, motion.q) if isinstance(q, Pose) else q
            motion.move(goal, a, in_time(v, t, a, goal, motion.q))
            yield from blended(r)

        def movel(pose: Sequence[float], a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> Wait:
            mine()
            place = placement(pose) if isinstance(pose, Pose) else controller.kinematics.forward(pose)
            left = controller.kinematics.error(place, controller.kinematics.forward(motion.q))
            motion.move_tool(vector(place).tolist(), a, in_time(v, t, a, left[:3], 0.0 * left[:3]))
            yield from blended(r)

        def movep(pose: Sequence[float], a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Wait:
            yield from movel(pose, a, v, 0.0, r)

        def blended(radius: float) -> Wait:
            """The rest of a move, up to where it blends into the next one."""
            if radius < 0:
                raise ValueError("a blend's radius is at least 0")
            doing = motion.doing
            yield from settled(
                lambda: motion.at_rest or (radius > 0 and motion.doing == doing and motion.left() < radius)
            )

        def settled(done: Callable[[], bool]) -> Wait:
            for _ in range(round(_LONGEST / CYCLE)):
                yield
                if done():
                    return

        return {
            "sync": sync, "sleep": sleep, "speedj": speedj, "speedl": speedl, "servoj": servoj, "servoc": servoc,
            "stopj": stopj, "stopl": stopl, "movej": movej, "movel": movel, "movep": movep,
        }  # fmt: skip


def in_time(speed: float, t: float, a: float, goal: Any, start: Any) -> float:
    """The cruising speed of a move: `speed`, or that which lets it take `t` seconds. Raises ValueError."""
    if t <= 0:
        return speed
    way = float(max(abs(g - s) for g, s in zip(goal, start, strict=True)))
    if a * a * t * t < 4 * a * way:
        raise ValueError(f"a move of {t:g} s needs a greater acceleration than {a:g}")
    return max((a * t - (a * a * t * t - 4 * a * way) ** 0.5) / 2, 1e-6)
