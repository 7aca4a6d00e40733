"""Opening MIT-mode actuators: who is there, whether it is what the profile says, and which turn its joint stands in.

A Damiao is only read, but for its watchdog and its control mode, both in memory that a power-off clears. A CubeMars V1
or V2 can be asked by enabling it alone, so the profile must allow that (sheet can_actuators, rules 1 and 2).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, floor, isclose
from typing import Final

import can

from srl.drivers.canbus import CanLink
from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.config import MARGIN, MitCanConfig, MotorConfig
from srl.drivers.mit_can.models import MODELS, Range
from srl.drivers.mit_can.protocol import MIT, Impedance, Register, State
from srl.runtime.contracts.errors import DeviceError

ANSWER: Final = 0.05  # s
TRIES: Final = 3
TWINS: Final = 0.005  # s after an answer in which another motor with the same id would answer, too
STATUS: Final = 0.4  # s: longer than a period of any AK V3 status that is fast enough to be used
_WIRES: Final = "Check its power, its CAN wires, the terminators (120 ohm at both ends), the bit rate and its id"


@dataclass(frozen=True)
class Found:
    """What was found, by motor.

    Attributes:
        spans: the ranges of its wire.
        offset: rad, from what the drive says to the shaft's angle: whole turns.
        states: the newest reply.
        words: firmware and the like, for people.
    """

    spans: list[Range]
    offset: list[float]
    states: list[State]
    words: str


class Opening:
    """One opening; see the module's docstring. Every method raises DeviceError with its remedy."""

    def __init__(self, link: CanLink, config: MitCanConfig, place: str, timeout: float = 1.0) -> None:
        """`timeout`: by how much it waits longer than usual; 0: whoever answers does so at once."""
        self._link, self._config, self._place, self._timeout = link, config, place, timeout
        self._v3 = config.generation == "v3"

    def find(self) -> Found:
        """Identifies, checks and configures all motors."""
        self._link.read()
        config = self._config
        spans, states, words = [], [], set[str]()
        if config.maker == "damiao":
            self._who_is_there()
        for name, motor in config.motors.items():
            who = f"'{name}' (id {motor.id})"
            if config.maker == "damiao":
                span, state, firmware = self._damiao(who, motor)
                words.add(f"firmware {firmware:g}")
            else:
                span = motor.span(config.generation)
                state = self._status(who, motor) if self._v3 else self._enabled(who, motor, span)
                words.add(f"firmware {config.firmware}, as the profile says")
            spans.append(span)
            states.append(state)
        offset = [
            self._turns(name, motor, state, span)
            for (name, motor), state, span in zip(config.motors.items(), states, spans, strict=True)
        ]
        return Found(spans, offset, states, ", ".join(sorted(words)))

    # -- Damiao

    def _who_is_there(self) -> None:
        """Tells who answers, if a motor of the profile doesn't."""
        config = self._config
        missing = [(name, motor) for name, motor in config.motors.items() if not self._states(motor, strict=False)]
        if not missing:
            return
        name, motor = missing[0]
        heard = {}
        for id in range(1, 16):
            self._send(protocol.REGISTERS, protocol.ask_state(id))
            for message in self._gather(lambda m: len(m.data) == 8, 0.01):
                heard[message.data[0] & 0xF] = message.arbitration_id
        wanted = config.reply_id(motor)
        if motor.id in heard:
            raise DeviceError(
                self._place,
                f"'{name}' (id {motor.id}) replies on {heard[motor.id]:#x}, the profile says {wanted:#x}",
                f"Set 'reply: {heard[motor.id]:#x}', or its MST_ID (register 7) with the maker's tool",
            )
        strangers = sorted(set(heard) - set(config.ids))
        others = (
            f"; motors that the profile doesn't name answer as {', '.join(map(str, strangers))}" if strangers else ""
        )
        if len(missing) == len(config.motors):
            raise DeviceError(self._place, f"no motor answers on {config.port}{others}", _WIRES)
        raise DeviceError(self._place, f"'{name}' (id {motor.id}) doesn't answer, others do{others}", _WIRES)

    def _damiao(self, who: str, motor: MotorConfig) -> tuple[Range, State, float]:
        own = self._read(who, motor, Register.ESC_ID)
        if int(own) != motor.id:
            raise DeviceError(
                self._place,
                f"{who} says that its id is {int(own)}: two motors reply on {self._config.reply_id(motor):#x}",
                "Connect them one by one, and give each an id (register 8) and a reply id (register 7) of its own",
            )
        if motor.serial is not None and (serial := int(self._read(who, motor, Register.SERIAL))) != motor.serial:
            raise DeviceError(
                self._place,
                f"{who} has the serial number {serial}, the profile says {motor.serial}",
                "It is another motor: two ids are swapped, or it was replaced. Swap them back, or measure its 'zero' "
                "anew and correct 'serial'",
            )
        span = Range(*(self._read(who, motor, r) for r in (Register.P_MAX, Register.V_MAX, Register.T_MAX)))
        expected = (motor.span("damiao"),) if motor.range is not None else motor.facts.ranges["damiao"]
        if not any(_same(span, known) for known in expected):
            alike = [m.name for m in MODELS.values() if any(_same(span, r) for r in m.ranges.get("damiao", ()))]
            guess = f"; these are those of {' and '.join(alike)}" if alike else ""
            problem = f"{who} scales by {_text(span)}, the profile's {motor.model} by {_text(expected[0])}{guess}"
            remedy = "Correct 'model' or the ids; if somebody has set these ranges, say so with 'range'"
            raise DeviceError(self._place, problem, remedy)
        gear, wanted = self._read(who, motor, Register.GEAR), motor.facts.gear
        if wanted is not None and not isclose(gear, wanted, rel_tol=0.02):
            problem = f"{who} has a gear of {gear:g}:1 in its memory, an {motor.model} one of {wanted:g}:1"
            raise DeviceError(self._place, problem, "Correct 'model', or its register 20 with the maker's tool")
        self._set(who, motor, Register.CTRL_MODE, MIT, "MIT mode")
        self._set(who, motor, Register.TIMEOUT, self._config.watchdog_ticks, "watchdog")
        states = self._states(motor)
        if len(states) != 1:
            raise self._silent(who) if not states else self._doubled(who)
        return span, protocol.damiao_reply(states[0], span), self._read(who, motor, Register.SOFTWARE)

    def _states(self, motor: MotorConfig, strict: bool = True) -> list[bytes]:
        """The answers to one question for the state: one of each motor with this id."""
        reply = self._config.reply_id(motor)

        def fits(message: can.Message) -> bool:
            return message.arbitration_id == reply and len(message.data) == 8 and message.data[0] & 0xF == motor.id

        ask = (protocol.REGISTERS, protocol.ask_state(motor.id))
        return [bytes(message.data) for message in self._answers([ask], fits, TWINS if strict else 0.0)]

    def _read(self, who: str, motor: MotorConfig, register: Register) -> float:
        values = self._ask(motor, protocol.read_register(motor.id, register), register)
        if not values:
            raise DeviceError(
                self._place,
                f"{who} answers, but not when its {register.name} (register {int(register)}) is read",
                _WIRES,
            )
        if len(values) > 1:
            raise self._doubled(who)
        return values[0]

    def _ask(self, motor: MotorConfig, data: bytes, register: Register) -> list[float]:
        reply = self._config.reply_id(motor)

        def fits(message: can.Message) -> bool:
            found = protocol.parse_register(bytes(message.data), motor.id)
            return message.arbitration_id == reply and found is not None and found[0] == register

        more = TWINS if register is Register.ESC_ID else 0.0
        found = self._answers([(protocol.REGISTERS, data)], fits, more)
        answers = [protocol.parse_register(bytes(message.data), motor.id) for message in found]
        return [answer[1] for answer in answers if answer is not None]

    def _set(self, who: str, motor: MotorConfig, register: Register, value: int, what: str) -> None:
        """Sets a register in the drive's memory and reads it back; an acknowledgement alone isn't trusted."""
        if self._read(who, motor, register) == value:
            return
        self._ask(motor, protocol.write_register(motor.id, register, value), register)
        if (found := self._read(who, motor, register)) != value:
            raise DeviceError(
                self._place,
                f"{who} doesn't take its {what}: register {int(register)} is {found:g}, not {value}",
                "Power it off and on, or set it with the maker's tool",
            )

    # -- CubeMars

    def _enabled(self, who: str, motor: MotorConfig, span: Range) -> State:
        """Enables an AK V1 or V2, followed at once by a command that only damps."""
        if not self._config.enable_at_open:
            raise DeviceError(
                self._place,
                "a CubeMars V1 or V2 tells where it stands only once it is enabled",
                "Add 'enable_at_open: true': it is then enabled with damping alone, without stiffness or torque",
            )
        damp = protocol.command(Impedance(kd=motor.damping), span)
        strangers = set()

        def fits(message: can.Message) -> bool:
            alike = message.arbitration_id in (0, motor.id) and 6 <= len(message.data) <= 8
            if alike and message.data[0] != motor.id:
                strangers.add(int(message.data[0]))
            return alike and bool(message.data[0] == motor.id) and not message.is_extended_id

        if found := self._answers([(motor.id, protocol.ENABLE), (motor.id, damp)], fits, TWINS):
            if len(found) > 2:
                raise self._doubled(who)
            return protocol.ak_reply(bytes(found[-1].data), span)
        heard = f"; {', '.join(map(str, sorted(strangers)))} answer" if strangers else ""
        raise DeviceError(
            self._place,
            f"{who} doesn't answer in MIT mode{heard}",
            f"{_WIRES}. A drive in servo mode is silent here, too: the maker's program shows its mode",
        )

    def _status(self, who: str, motor: MotorConfig) -> State:
        """Listens for the status of an AK V3."""
        config, reply = self._config, self._config.reply_id(motor)
        heard = set()

        def fits(message: can.Message) -> bool:
            if message.is_extended_id and message.arbitration_id >> 8 == protocol.V3_STATUS >> 8:
                heard.add(message.arbitration_id & 0xFF)
            return message.is_extended_id and message.arbitration_id == reply and len(message.data) == 8

        found = self._gather(fits, STATUS)
        if not found and config.enable_at_open:
            data = protocol.command(Impedance(kd=motor.damping), motor.span("v3"), v3=True)
            self._send(protocol.V3_COMMAND + motor.id, data, extended=True)
            found = self._gather(fits, ANSWER)
        if not found:
            others = f"; {', '.join(map(str, sorted(heard)))} do" if heard else ""
            raise DeviceError(
                self._place,
                f"{who} sends no status{others}",
                f"{_WIRES}. Switch its periodic status on in the maker's program, at the loop's rate or more, or add "
                "'enable_at_open: true'",
            )
        return protocol.v3_status(bytes(found[-1].data), *protocol.status_scale(motor.facts))

    # -- turns

    def _turns(self, name: str, motor: MotorConfig, state: State, span: Range) -> float:
        """The whole turns to add to what the drive says: those that bring the joint into its travel, or to its park."""
        who = f"'{name}' (id {motor.id})"
        if abs(state.position) > span.position - MARGIN:
            raise DeviceError(
                self._place,
                f"{who} stands at {state.position:.2f} rad, where its range of ±{span.position:g} ends and wraps",
                "Turn it back by hand, or set its zero with the maker's tool",
            )
        turn, scale = motor.turn, motor.scale
        if turn is None:
            raise DeviceError(
                self._place,
                f"{who}: the gear of an {motor.model} isn't known",
                "Set 'encoder: output' if it has one there",
            )
        assert motor.lower is not None
        assert motor.upper is not None
        slack = self._config.start_tolerance * abs(scale)
        axis = (state.position - motor.zero) * scale
        step = turn * abs(scale)
        low, high = ceil((motor.lower - slack - axis) / step), floor((motor.upper + slack - axis) / step)
        places = [axis + k * step for k in range(low, high + 1)]
        could = ", ".join(f"{place:.2f}" for place in places)
        if motor.park is not None:
            park = motor.park
            near = min(places, key=lambda place: abs(place - park), default=None)
            if near is None or abs(near - park) > step / 4:
                raise DeviceError(
                    self._place,
                    f"{who} isn't parked at {park:g}: it could stand at {could or 'no angle of its travel'}",
                    "Power it off, bring it to its park by hand, power it on and open it again",
                )
            places = [near]
        if not places:
            raise DeviceError(
                self._place,
                f"{who} stands at {axis:.2f}, outside its travel of {motor.lower:g} to {motor.upper:g}, whatever turns "
                "it has lost",
                "Bring it back by hand; if it is inside, correct 'zero', 'lower', 'upper' or 'reversed'",
            )
        if len(places) > 1:
            raise DeviceError(
                self._place,
                f"{who} could stand at {could}: after power-up its encoder knows its angle only within {step:.2f}",
                "Add 'park', the angle at which it rests when it gets power, and bring it there before; or narrow its "
                "travel",
            )
        return (places[0] - axis) / scale

    # -- the bus

    def _silent(self, who: str) -> DeviceError:
        return DeviceError(self._place, f"{who} doesn't answer any more", _WIRES)

    def _doubled(self, who: str) -> DeviceError:
        return DeviceError(
            self._place, f"two motors answer as {who}", "Connect them one by one and give each an id of its own"
        )

    def _answers(
        self, question: list[tuple[int, bytes]], fits: Callable[[can.Message], bool], more: float
    ) -> list[can.Message]:
        """The answers to these frames, which are sent again while none comes: more than they are tell of two motors.

        On a busy host an answer may be late, and then come with the next one; after a reconnection the answers to the
        last commands may come with the first. Such a crowd is of one motor as well as of two, so it is asked again
        after a pause in which what is late comes in, until it comes again or one alone has answered twice.
        """
        found, alone = list[can.Message](), 0
        for k in range(2 * TRIES):
            if found:
                self._gather(lambda _: False, ANSWER)
            elif k == TRIES:
                break
            self._link.read()
            for id, data in question:
                self._send(id, data)
            if now := self._gather(fits, ANSWER, more):
                if len(now) > len(question):
                    if found:
                        return now
                    found = now
                else:
                    alone += 1
                    if not found or alone > 1:
                        return now
        return found

    def _gather(self, fits: Callable[[can.Message], bool], timeout: float, more: float = 0.0) -> list[can.Message]:
        """The frames that fit: the first within `timeout`, further ones within `more` after it."""
        deadline, found = time.monotonic() + timeout * self._timeout, list[can.Message]()
        while True:
            left = deadline - time.monotonic()
            new = [message for message in self._link.read_wait(max(left, 0.0)) if fits(message)]
            if new and not found:
                deadline = time.monotonic() + more * min(self._timeout, 1.0)
            found += new
            if time.monotonic() >= deadline:
                return found

    def _send(self, id: int, data: bytes, extended: bool = False) -> None:
        deadline = time.monotonic() + ANSWER
        while not self._link.write(can.Message(arbitration_id=id, data=data, is_extended_id=extended)):
            if time.monotonic() > deadline:
                raise DeviceError(
                    self._place,
                    f"{self._config.port} takes no frame: nobody acknowledges it",
                    "Check the motors' power (an e-stop?), the wires and the bit rate. Then take the interface down "
                    "and up, which discards the frames that wait in it",
                )
            time.sleep(0.001)


def _same(one: Range, other: Range) -> bool:
    pairs = (one.position, other.position), (one.velocity, other.velocity), (one.torque, other.torque)
    return all(abs(a - b) <= 1e-3 * abs(b) for a, b in pairs)


def _text(span: Range) -> str:
    return f"±{span.position:g} rad, ±{span.velocity:g} rad/s, ±{span.torque:g} N m"
