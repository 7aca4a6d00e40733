"""Programs that run on the twin's controller: URScript, and ur_rtde's own program, recognised by its name."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from typing import Any, Final

from drivers.ur.registers import CYCLE
from sim.devices.ur.controller import UrController
from sim.devices.ur.twin_expressions import ScriptError
from sim.devices.ur.twin_registers import Registers
from sim.devices.ur.twin_script import Script, Wait

SERVO_GAIN: Final = 300.0
_LONGEST: Final = 3600.0  # s, longest duration of a motion that has an end


class UrScriptProgram:
    """A program in the small URScript.

    Attributes:
        name: the program's name.
        error: why it ended early.
    """

    def __init__(self, text: str, controller: UrController, registers: Registers) -> None:
        """Raises ScriptError: the text isn't a valid program."""
        self._controller, self._registers = controller, registers
        self.error = ""
        self.texts: list[str] = []
        self._script = Script(text, self._functions(), self._motions())
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

    def _functions(self) -> dict[str, Callable[..., Any]]:
        controller, inputs, outputs = self._controller, self._registers.inputs, self._registers.outputs
        motion = controller.motion

        def set_digital(number: int, on: bool) -> None:
            if not 0 <= number < 18:
                raise ValueError(f"there is no digital output {number}")
            bit = 1 << number
            controller.outputs = controller.outputs | bit if on else controller.outputs & ~bit

        return {
            "read_input_integer_register": inputs.ints.__getitem__,
            "read_input_float_register": inputs.doubles.__getitem__,
            "read_input_boolean_register": inputs.bits.__getitem__,
            "write_output_integer_register": self._registers.write_int,
            "write_output_float_register": lambda number, value: outputs.doubles.__setitem__(number, float(value)),
            "write_output_boolean_register": lambda number, value: outputs.bits.__setitem__(number, bool(value)),
            "rtde_set_watchdog": self._registers.watch,
            "set_payload": lambda mass, cog=(0.0, 0.0, 0.0): controller.set_payload(mass, tuple(cog)),
            "get_target_payload": lambda: controller.payload[0],
            "get_target_payload_cog": lambda: list(controller.payload[1]),
            "norm": lambda of: hypot(*of) if isinstance(of, list) else abs(of),
            "set_digital_out": set_digital,
            "set_standard_digital_out": set_digital,
            "get_actual_joint_positions": lambda: list(map(float, controller.arm.position)),
            "get_target_joint_positions": motion.q.tolist,
            "get_target_joint_speeds": motion.qd.tolist,
            "get_steptime": lambda: CYCLE,
            "textmsg": lambda *parts: self.texts.append("".join(str(part) for part in parts)),
        }

    def _motions(self) -> dict[str, Callable[..., Wait]]:
        motion = self._controller.motion

        def sync() -> Wait:
            yield

        def sleep(t: float) -> Wait:
            for _ in range(max(1, round(t / CYCLE))):
                yield

        def speedj(qd: list[float], a: float = 1.4, t: float = 0.0) -> Wait:
            motion.speed(qd, a)
            yield from sleep(t) if t else settled(lambda: abs(motion.qd - qd).max() < 1e-6)

        def servoj(
            q: list[float], a: float = 0.0, v: float = 0.0, t: float = CYCLE, lookahead_time: float = 0.1,
            gain: float = SERVO_GAIN,
        ) -> Wait:  # fmt: skip
            motion.servo(q, lookahead_time, gain)
            yield from sleep(t)

        def stopj(a: float) -> Wait:
            motion.stop(a)
            yield from settled(lambda: motion.at_rest)

        def movej(q: list[float], a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Wait:
            motion.move(q, a, v)
            yield from settled(lambda: motion.at_rest)

        def settled(done: Callable[[], bool]) -> Wait:
            for _ in range(round(_LONGEST / CYCLE)):
                yield
                if done():
                    return

        return {"sync": sync, "sleep": sleep, "speedj": speedj, "servoj": servoj, "stopj": stopj, "movej": movej}


class RegisterProgram:
    """ur_rtde's control program, known only by its register protocol.

    Source: protocol sheet ur-rtde, sections 5.2, 6. Output register 0 is 1: ready, 2: done. Joint motions, stops and
    the payload are carried out; command 40 sets six output registers to 0. Other commands are answered as done and
    do nothing.

    Attributes:
        ignored: how often each command that did nothing came, by its number.
    """

    NAME: Final = "rtde_control"
    EVERY_CYCLE: Final = frozenset((6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71))
    READY: Final = 1
    DONE: Final = 2

    def __init__(self, controller: UrController, registers: Registers, offset: int = 0) -> None:
        self.name, self.error = self.NAME, ""
        self.ignored: dict[int, int] = {}
        self._controller, self._registers, self._first = controller, registers, offset
        self._begun = self._done = False
        registers.inputs.ints[offset] = 0
        self._answer(self.READY)

    def cycle(self) -> bool:
        """Runs its loop once; returns False once the program has ended."""
        try:
            return self._pass()
        except ValueError as error:
            self.error = str(error)
            return False

    def _pass(self) -> bool:
        number = self._int(0)
        if number == 255:
            self._answer(0)
            self._controller.motion.stop(4.0)
            return False
        if number == 0:
            self._begun = self._done = False
            self._answer(self.READY)
        elif number in self.EVERY_CYCLE:
            self._do(number)
            self._answer(self.READY)
        elif not self._done and self._do(number):
            self._done = True
            self._answer(self.DONE)
        return True

    def _do(self, number: int) -> bool:
        """Begins a command, or checks whether it has finished; returns whether it is done."""
        motion, doubles = self._controller.motion, self._doubles
        if number == 9:
            motion.speed(doubles(0, 6), doubles(6, 1)[0])
        elif number == 11:
            motion.servo(doubles(0, 6), *doubles(9, 2))
        elif self._begun:
            return motion.at_rest
        elif number == 1:
            speed, acceleration = doubles(6, 2)
            motion.move(doubles(0, 6), acceleration, speed)
            self._begun = True
            return self._int(1) == 1
        elif number in (15, 16, 34):
            motion.stop(max(doubles(0, 1)[0], 0.1))
            self._begun = True
            return False
        elif number == 17:
            mass, *cog = doubles(0, 4)
            self._controller.set_payload(mass, (cog[0], cog[1], cog[2]))
        elif number == 40:
            self._registers.outputs.doubles[self._first : self._first + 6] = [0.0] * 6
        else:
            self.ignored[number] = self.ignored.get(number, 0) + 1
        return True

    def _int(self, number: int) -> int:
        return self._registers.inputs.ints[self._first + number]

    def _doubles(self, first: int, count: int) -> list[float]:
        return self._registers.inputs.doubles[self._first + first : self._first + first + count]

    def _answer(self, value: int) -> None:
        self._registers.outputs.ints[self._first] = value
