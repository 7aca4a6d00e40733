"""The Logitech F310 as a device (sheet gamepad_f310_and_ring, part B, X mode)."""

from __future__ import annotations

from math import hypot
from typing import Final

from pydantic import Field

from srl.drivers.evdev import AxisInfo, Description, Event, EventSource, discover, open_source
from srl.drivers.evdev.records import EV_ABS, EV_KEY
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Signal

VENDOR, X_MODE, D_MODE = 0x046D, 0xC21D, 0xC216
STICKS: Final = (0x00, 0x01, 0x03, 0x04)  # ABS_X, ABS_Y, ABS_RX, ABS_RY: right and down are positive
TRIGGERS: Final = (0x02, 0x05)  # ABS_Z, ABS_RZ
HAT: Final = (0x10, 0x11)
BUTTONS: Final = {
    "a": 0x130, "b": 0x131, "x": 0x133, "y": 0x134, "lb": 0x136, "rb": 0x137,
    "back": 0x13A, "start": 0x13B, "logitech": 0x13C, "left_stick": 0x13D, "right_stick": 0x13E,
}  # fmt: skip
AXES: Final = ("left_x", "left_y", "right_x", "right_y", "left_trigger", "right_trigger")
_ANSWER: Final = 1.0  # s for a twin to describe itself
_X_REMEDY: Final = "Set the switch on its back to X"
REST: Final = 0.1  # of its whole way: an axis nearer to its rest is at rest


class GamepadConfig(DeviceConfig):
    """Options of a gamepad."""

    port: str = Field("auto", description="'auto' finds it by its USB number; else a path such as /dev/input/by-id/...")
    dead_zone: float = Field(0.1, ge=0, lt=1, description="of full scale: sticks nearer to their centre read 0")
    grab: bool = Field(True, description="no other program gets its events")


class Gamepad(Sensor):
    """A gamepad with two sticks, two triggers, a d-pad and eleven buttons.

    States: `axes` (6,) and `dpad` (2,), 1; `buttons` (11,), 0 or 1.

    Sticks are -1 to 1 with right and up positive, triggers 0 (released) to 1, d-pad -1, 0, 1. A dead zone around each
    stick's centre is removed and the rest is stretched, so that motion begins at 0. The device sends only changes, so
    silence isn't a fault: the newest state is valid as long as the kernel has the device, and `stamp` is the time of
    each read. When the device is unplugged, all values are neutral and the device is lost.
    """

    Config = GamepadConfig
    summary = "Logitech F310 gamepad in X mode (Linux input device)"
    gives = ("axes", "dpad", "buttons")
    among_inputs = ("auto",)
    max_age = 0.1

    def __init__(self, name: str, config: GamepadConfig) -> None:
        super().__init__(name, config)
        self.states = (
            Signal(name="axes", shape=(6,), unit="1", labels=AXES),
            Signal(name="dpad", shape=(2,), unit="1", labels=("x", "y")),
            Signal(name="buttons", shape=(len(BUTTONS),), unit="1", labels=tuple(BUTTONS)),
        )
        self._port, self._dead_zone, self._grab = config.port, config.dead_zone, config.grab
        self._source: EventSource | None = None
        self._ranges: dict[int, AxisInfo] = {}
        self._axes: dict[int, float] = {}
        self._keys: dict[int, float] = {}
        self._seen = (0, 0, 0)  # the parser's counts when last copied
        self._name = ""
        self._held: dict[int, str] = {}  # axes, by index, that haven't been at rest since it was opened

    def open(self) -> None:
        self.close()
        source = self._find()
        try:
            described = source.await_description(_ANSWER)
            self._check(source.path, described)
        except DeviceError:
            source.close()
            raise
        self._source = source
        self._ranges = described.axes
        self._axes = {code: axis.value for code, axis in described.axes.items()}
        self._keys = {code: float(code in described.pressed) for code in described.keys}
        self._seen = (0, 0, 0)
        self._name = self.health.message = described.name
        self._held = dict(enumerate(AXES))
        self.health.opened()
        self._fill()

    def read(self, now: int) -> None:
        source = self._source
        if source is None:
            raise DeviceLostError(self.name, "it isn't open", "Open it first")
        try:
            reports = source.read()
        except DeviceLostError as error:
            self._neutral()
            self.health.lost(error.problem)
            raise
        for report in reports:
            self._take(report)
        self._fill()
        self.health.stamp = now
        parser = source.parser
        counts = (parser.frames, parser.errors, parser.drops)
        health = self.health
        health.frames += counts[0] - self._seen[0]
        health.errors += counts[1] - self._seen[1]
        health.resyncs += counts[2] - self._seen[2]
        self._seen = counts

    def close(self) -> None:
        source, self._source = self._source, None
        self.health.connected = False
        if source is not None:
            source.close()

    # -- cycle

    def _take(self, report: list[Event]) -> None:
        for _, kind, code, value in report:
            if kind == EV_ABS and code in self._ranges:
                self._axes[code] = value
            elif kind == EV_KEY and code in self._keys:
                self._keys[code] = float(value != 0)

    def _fill(self) -> None:
        axes, scaled = self.state_arrays["axes"], self._centred
        for i in (0, 2):
            axes[i : i + 2] = self._stick(scaled(STICKS[i]), -scaled(STICKS[i + 1]))
        for i, code in enumerate(TRIGGERS, 4):
            low, high = self._ranges[code][1:3]
            axes[i] = max(0.0, min(1.0, (self._axes[code] - low) / (high - low)))
        self.state_arrays["dpad"][:] = scaled(HAT[0]), -scaled(HAT[1])
        self.state_arrays["buttons"][:] = [self._keys[code] for code in BUTTONS.values()]
        if self._held:
            self._await_rest()

    def _await_rest(self) -> None:
        """Nothing that is held while the pad is opened counts, before it was at rest once."""
        axes = self.state_arrays["axes"]
        self._held = {i: name for i, name in self._held.items() if abs(axes[i]) > REST}
        axes[list(self._held)] = 0.0
        held = ", ".join(self._held.values())
        self.health.message = f"let go of {held}: it counts from its rest on" if held else self._name

    def _neutral(self) -> None:
        for values in self.state_arrays.values():
            values[:] = 0.0

    def _centred(self, code: int) -> float:
        """Scales a value to -1 to 1 over the axis's own range."""
        _, low, high, *_ = self._ranges[code]
        middle = (low + high + 1) // 2  # 0 for -32768..32767
        value = self._axes[code] - middle
        return max(-1.0, min(1.0, value / (high - middle)))

    def _stick(self, x: float, y: float) -> tuple[float, float]:
        size = hypot(x, y)
        if size <= self._dead_zone:
            return 0.0, 0.0
        scale = (min(size, 1.0) - self._dead_zone) / (1 - self._dead_zone) / size
        return x * scale, y * scale

    # -- opening

    def _find(self) -> EventSource:
        if self._port != "auto":
            return open_source(self._port, f"{self.name} ({self._port})", self._grab)
        seen, refused = [], None
        for path in discover():
            try:
                source = open_source(path, self.name)
            except DeviceError as error:
                refused = error
                continue
            described = source.description
            assert described is not None
            numbers = (described.vendor, described.product)
            if numbers == (VENDOR, D_MODE):
                source.close()
                raise DeviceError(f"{self.name} ({path})", f"'{described.name}' is in D mode", _X_REMEDY)
            source.close()
            if numbers == (VENDOR, X_MODE):
                return open_source(path, f"{self.name} ({path})", self._grab)
            seen.append(described.name)
        if refused is not None and not seen:
            raise refused
        raise DeviceError(
            self.name,
            f"no Logitech F310 is plugged in; input devices found: {', '.join(seen) or 'none'}",
            "Plug it in, or name another pad's path as 'port'",
        )

    def _check(self, path: str, described: Description) -> None:
        place = f"{self.name} ({path})"
        if (described.vendor, described.product) == (VENDOR, D_MODE):
            raise DeviceError(place, f"'{described.name}' is in D mode", _X_REMEDY)
        axes = [code for code in (*STICKS, *TRIGGERS, *HAT) if code not in described.axes]
        keys = [name for name, code in BUTTONS.items() if code not in described.keys]
        if axes or keys:
            missing = [f"axis {code:#04x}" for code in axes] + keys
            raise DeviceError(
                place,
                f"'{described.name}' isn't a pad in X mode: it lacks {', '.join(missing)}",
                f"{_X_REMEDY}; unset options of the kernel's xpad module such as dpad_to_buttons",
            )
        # A centred axis needs at least one step to each side; other axes of the device don't matter.
        steps = {code: 1 if code in TRIGGERS else 2 for code in (*STICKS, *TRIGGERS, *HAT)}
        flat = [c for c, least in steps.items() if described.axes[c].maximum - described.axes[c].minimum < least]
        if flat:
            raise DeviceError(place, f"axis {flat[0]:#04x} has no range", "Plug it in again")
        # Of a generic pad these codes are other axes: its second stick is where the triggers are here.
        other = [code for code in STICKS if not described.axes[code].minimum < 0 < described.axes[code].maximum]
        other += [code for code in TRIGGERS if described.axes[code].minimum < 0]
        if other:
            low, high = described.axes[other[0]].minimum, described.axes[other[0]].maximum
            problem = f"'{described.name}' has another layout: its axis {other[0]:#04x} goes from {low} to {high}"
            raise DeviceError(place, problem, _X_REMEDY)
