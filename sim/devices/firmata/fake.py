"""An Arduino with StandardFirmata in the simulated world: servos on the extra finger, scripted buttons."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Final, Protocol, cast

import numpy as np
from pydantic import ConfigDict, Field

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.analog import FULL, Analog
from srl.drivers.firmata.config import Calibration, FirmataConfig
from srl.drivers.firmata.driver import COMMAND
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.windows import Windows, inside, lose_while_gone, refuse_while_gone, require_cell
from srl.sim.parts.hand.servos import Servos

_NEUTRAL: Final = 1500  # us, pulse width of an attached servo before its first command


class Ends(BaseModel):
    """How a servo really sits: the world's joint angles at both ends of its pulses (`min_us`, `max_us`, `trim_us`)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    shortest: float = Field(allow_inf_nan=False, description="rad, at the shortest pulse")
    longest: float = Field(allow_inf_nan=False, description="rad, at the longest pulse")


class FakeFirmataConfig(FakeConfig):
    """Options of the fake."""

    characteristic: dict[str, Ends] = Field(
        default={}, description="how servos really sit, by joint; the others are as the profile and its calibration say"
    )

    joints: dict[str, str] = Field(
        default={}, description="the world's servo that each of the board's turns; those not listed go by their names"
    )
    delay: float = Field(default=0.003, ge=0, le=1, description="s, from the command to the board's new pulse width")
    frame_rate: float = Field(
        default=50.0, gt=0, le=1000, description="Hz of servo pulses: a new width waits for the next"
    )
    presses: dict[str, Windows] = Field(
        default={}, description="s, by button: [from, to] pairs in world time during which it is pressed"
    )
    analog: dict[str, list[tuple[float, float]]] = Field(
        default={}, description="of an analog input: [[s, share of the supply], ...], lines between; else a wave"
    )
    person: str | None = Field(default=None, description="the cell's part that presses the buttons, besides `presses`")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the board is gone")


class Presser(Protocol):
    """A part of the cell that presses buttons."""

    buttons: tuple[str, ...]

    def pressed(self, button: str) -> bool: ...


class FakeFirmata(Fake):
    """Servos get whole microseconds, `delay` later, at the next pulse; detached servos are limp.

    As on the real board, opening resets it, which detaches the servos. A board that is lost continues with its last
    pulses. `read`, `write` and `stop` are the driver's interface. The methods `attach`, `set_pulse`, `detach` and
    `button` are the board itself; a twin uses them, too.
    """

    Options = FakeFirmataConfig
    real = Firmata
    config: FirmataConfig

    def __init__(self, name: str, config: FirmataConfig, world: World, options: FakeFirmataConfig) -> None:
        super().__init__(name, config, world, options)
        real = Firmata(name, config)
        self._options = options
        self._calibrations = real.calibrations
        self._joints, self._buttons = tuple(config.servos), tuple(config.buttons)
        self._truth = tuple(self._calibrations)
        for joint, ends in options.characteristic.items():
            self._seat(joint, ends, config)
        n = len(self._joints)
        self._turns: list[str] = []  # the name of the world's servo that each of the board's is
        if n:
            self._mount(world)
        if unknown := set(options.analog) - set(config.analog):
            problem = f"the board has no analog input '{min(unknown)}'"
            raise WiringError(f"sim.devices.{name}.analog", problem, nearest(min(unknown), config.analog))
        self._analog = Analog(config.analog, config.analog_interval)
        if unknown := set(options.presses) - set(self._buttons):
            raise WiringError(
                f"sim.devices.{name}.presses", f"the board has no button '{unknown.pop()}'", "Name one it has"
            )
        self._levels = [
            _settled(options.presses.get(button, ()), config.buttons[button].debounce) for button in self._buttons
        ]
        self._person = self._find(options.person)
        self._waits = [round(config.buttons[button].debounce * 1e9) for button in self._buttons]
        self._seen = [(False, 0)] * len(self._buttons)  # (state of the person's finger, since when in ns)
        self._steady = [False] * len(self._buttons)
        self._bounds = [(544, 2400)] * n
        self._pulses: list[int | None] = [None] * n
        self._widths = [_NEUTRAL] * n  # the last pulse widths; an attached servo starts with its own
        self._delay = round(options.delay * 1e9)
        frame = Fraction(10**9) / Fraction(options.frame_rate).limit_denominator(10**6)
        self._frame = frame.as_integer_ratio()  # ns, as a rational

    def _seat(self, joint: str, ends: Ends, config: FirmataConfig) -> None:
        """Takes over how a servo really sits, which the driver doesn't know. Raises WiringError."""
        place = f"sim.devices.{self.name}.characteristic"
        if joint not in self._joints:
            raise WiringError(place, f"the board has no servo '{joint}'", nearest(joint, self._joints))
        servo, i = config.servos[joint], self._joints.index(joint)
        slope = (servo.max_us - servo.min_us) / (ends.longest - ends.shortest) if ends.longest != ends.shortest else 0.0
        if not slope:
            raise WiringError(f"{place}.{joint}", "both ends are one angle", "Give two angles")
        known, zero = self._calibrations[i], servo.min_us + servo.trim_us - slope * ends.shortest
        true = Calibration(slope, zero, known.shortest, known.longest)
        self._truth = (*self._truth[:i], true, *self._truth[i + 1 :])

    def looks(self) -> Array:
        angles = self.servos.angles()
        return np.array([angles[name] for name in self._turns])

    def _mount(self, world: World) -> None:
        """Finds the world's servos; a board with buttons only needs none."""
        self.servos = Servos(require_cell(world, self.name))
        there, given = self.servos.names, self._options.joints
        place = f"sim.devices.{self.name}.joints"
        if unknown := set(given) - set(self._joints):
            raise WiringError(place, f"the board has no servo '{min(unknown)}'", nearest(min(unknown), self._joints))
        turned = [given.get(joint, joint) for joint in self._joints]
        for joint in turned:
            if joint in there and (other := self.servos.taken(joint, self.name)):
                raise WiringError(place, f"'{other}' turns the world's servo '{joint}' already", "Name another")
        if set(turned) - set(there) or len(set(turned)) < len(turned):
            raise WiringError(
                place,
                f"the board's servos turn {', '.join(turned)}; the world has {', '.join(there) or 'none'}",
                "Name one of the world's for each of the board's, as {knuckle: abduction}",
            )
        self._turns = turned
        self.servos.place(dict(zip(turned, self.home[COMMAND].tolist(), strict=True)))

    def _find(self, named: str | None) -> Presser | None:
        """Finds the simulated person; the person's buttons must be on the board."""
        if named is None:
            return None
        place, parts = f"sim.devices.{self.name}.person", getattr(self.world, "parts", {})
        person = parts.get(named)
        if person is None or not hasattr(person, "pressed"):
            raise WiringError(place, f"the world has no person '{named}'", "Name a part of kind person")
        if unknown := set(person.buttons) - set(self._buttons):
            raise WiringError(
                place, f"the person's plan presses '{min(unknown)}', which the board hasn't", "Name a button it has"
            )
        return cast(Presser, person)

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        self.reset()
        self.health.opened()
        self.health.message = "simulated StandardFirmata"

    def read(self, now: int) -> None:
        self._check()
        self.health.stamp = now
        self.health.frames += 1
        for name, channel in zip(self.config.analog, self._analog.channels, strict=True):
            self._analog.take(channel, self.reading(name), now)
        if self.config.analog:
            self.state_arrays["analog"][:] = self._analog.values
            self.health.stamp = self._analog.stamp
            self.health.message = self._analog.problem
        if self.config.buttons:
            found, t, person = [], self.world.time * 1e-9, self._person
            for i, levels in enumerate(self._levels):
                level = 0.0
                for since, new in levels:
                    if since <= t:
                        level = new
                found.append(1.0 if person is not None and self._pressed(i, person) else level)
            self.state_arrays["buttons"][:] = found

    def write(self, now: int) -> None:
        self._check()
        if not self.commands:
            return
        targets: dict[str, float | None] = {}
        for i, angle in enumerate(self.command_arrays[COMMAND].tolist()):
            if not math.isfinite(angle):
                continue
            calibration = self._calibrations[i]
            self.sent_arrays[COMMAND][i] = min(max(angle, calibration.lower), calibration.upper)
            if self._pulses[i] is None:
                self._bounds[i] = (calibration.shortest, calibration.longest)
            targets[self._turns[i]] = self._angle(i, calibration.pulse(angle))
        self._send(targets)

    def stop(self, category: Stop) -> None:
        """LIMP detaches the servos; any other category keeps their last pulse."""
        if category is Stop.LIMP and self.health.connected:
            for i in range(len(self._joints)):
                self.detach(i)

    def close(self) -> None:
        """Servos that weren't made limp continue with their last pulse."""
        self.health.connected = False

    def metrics(self) -> dict[str, object]:
        """Pulse widths (us, None while detached) by joint."""
        return {"pulses_us": dict(zip(self._joints, self._pulses, strict=True))}

    # -- the board itself, used by the fake and the twin; joints and buttons by their number in the profile

    def attach(self, joint: int, min_us: int, max_us: int) -> None:
        """Starts pulses with the last width (1500 us at first), clipped to the bounds like all later ones."""
        self._bounds[joint] = (min_us, max_us)
        self.set_pulse(joint, self._widths[joint])

    def set_pulse(self, joint: int, us: int) -> None:
        """Sets the pulse width of an attached servo; it takes effect `delay` later, at the next pulse."""
        self._send({self._turns[joint]: self._angle(joint, us)})

    def detach(self, joint: int) -> None:
        """Ends a servo's pulses, which leaves it limp."""
        if self._pulses[joint] is not None:
            self._pulses[joint] = None
            self._send({self._turns[joint]: None})

    def reset(self) -> None:
        """Resets the board: its servos are detached and their last widths are cleared."""
        for joint in range(len(self._joints)):
            self.detach(joint)
        self._widths = [_NEUTRAL] * len(self._joints)

    def reading(self, name: str) -> int:
        """Of an analog input now, 0 to 1023: without a plan the wave of a foot that presses every 6 s."""
        t, plan = self.world.time * 1e-9, self._options.analog.get(name)
        if plan:
            share = float(np.interp(t, [at for at, _ in plan], [level for _, level in plan]))
        else:
            share = 0.25 * (1.0 - math.cos(2.0 * math.pi * t / 6.0))
        return round(min(max(share, 0.0), 1.0) * FULL)

    def button(self, number: int) -> bool:
        """Whether a button is pressed now; debouncing is left to the driver."""
        if self._person is not None and self._person.pressed(self._buttons[number]):
            return True
        return inside(self._options.presses.get(self._buttons[number], ()), self.world.time)

    def _pressed(self, number: int, person: Presser) -> bool:
        """The state of the person's finger on a button, debounced at each read as the real driver does."""
        now, down = self.world.time, person.pressed(self._buttons[number])
        was, since = self._seen[number]
        if down == was == self._steady[number] and now >= since:
            return down
        if down != was or now < since:
            self._seen[number], since = (down, now), now
        if now - since >= self._waits[number]:
            self._steady[number] = down
        return self._steady[number]

    def _angle(self, joint: int, us: int) -> float:
        """The angle (rad) for a servo's new pulse width, which is stored and clipped to the servo's bounds."""
        low, high = self._bounds[joint]
        pulse = low if us < low else high if us > high else us
        self._pulses[joint] = self._widths[joint] = pulse
        return self._truth[joint].angle(pulse)

    def _send(self, targets: Mapping[str, float | None]) -> None:
        """Sends targets, by the world's servo, that apply from the first pulse after the delay."""
        ns, per = self._frame
        frame = -(-(self.world.time + self._delay) * per // ns)
        self.servos.set(targets, frame * ns // per)

    def _check(self) -> None:
        lose_while_gone(self, self._options.loss)


def _settled(presses: Windows, wait: float) -> list[tuple[float, float]]:
    """(since s, level), debounced as the real driver does: a level counts once it has lasted for `wait` s."""
    edges = [edge for press in presses for edge in press]
    ends = [*edges[1:], math.inf]
    return [
        (edge + wait, 1.0 - i % 2) for i, (edge, end) in enumerate(zip(edges, ends, strict=False)) if end - edge >= wait
    ]
