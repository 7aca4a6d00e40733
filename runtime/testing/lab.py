"""A profile on its fakes, in the test's own process: cycle by cycle, with faults, and with words for what is wrong.

No socket, no thread, no process, and no clock: time is the world's, so a run gives the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite, isnan
from typing import Self

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_CONNECTED, LINK_STALE, Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import wiring
from srl.runtime.profile.plots import element_names, pick, split
from srl.runtime.testing.faults import FaultyDevice
from srl.runtime.testing.given import Given, read

MOST = 30.0  # s of world time that `until` waits


class Lab:
    """A profile on its fakes; see the module's docstring. A context manager; `close` ends it, and may come twice.

    A signal is named as in a picture's plots: "plate.force", one element of it "plate.force[fz]".

    Attributes:
        layout: names, shapes and units of all signals.
        events: the loop's events, as text.
    """

    def __init__(self, given: Given, overrides: Sequence[str] = ()) -> None:
        """Opens the fakes; nothing has run yet.

        Args:
            given: the profile: a path, the name of one that comes with srl, YAML text, or its keys as a dict.
            overrides: as `srl run` takes them with `--set`: "seed=3", "sim.devices.plate.noise=0".
        Raises:
            ProfileError, WiringError: as `srl check PROFILE --sim` says it.
            DeviceError: a fake refuses to open.
        """
        self._graph = wiring.build(*read(given, overrides), [])
        self.layout: Layout = self._graph.layout
        self.events: list[str] = []
        self._rows: list[NDArray[np.int64]] = []
        self._faults = {driver.name: FaultyDevice(driver) for driver in self._graph.devices}
        self._sent: dict[str, Array] = {}  # setpoints that a client sends, by name
        self._closed = False
        try:
            self._lockstep = Lockstep(self._graph, self.events.append)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the fakes and the world; what has run stays readable."""
        if self._closed:
            return
        self._closed = True
        for driver in self._graph.devices:
            driver.close()
        if self._graph.world is not None:
            self._graph.world.close()

    # -- time

    @property
    def time(self) -> float:
        """s of world time since the start."""
        return self.cycles * self._lockstep.period * 1e-9

    @property
    def cycles(self) -> int:
        """Number of cycles that have run."""
        return len(self._rows)

    def step(self, cycles: int = 1) -> None:
        """Runs so many cycles."""
        if cycles < 0:
            raise RequestError("step", f"{cycles} cycles can't be run", "Time doesn't go back: give 0 or more")
        for _ in range(cycles):
            self._cycle(RequestKind.NONE)

    def run(self, seconds: float) -> None:
        """Runs so much of the world's time, to the nearest cycle."""
        self.step(self._cycles_of(seconds))

    def until(
        self,
        what: str | Callable[[], object],
        *,
        above: float | None = None,
        below: float | None = None,
        most: float = MOST,
    ) -> None:
        """Runs until it is so; looks first, so what is so already takes no time.

        Args:
            what: a state ("active", "stopped"); a signal, with `above` or `below`; or a function without arguments.
            above, below: in the signal's unit; every element must be beyond it.
            most: s of world time.
        Raises:
            AssertionError: it wasn't so in this time. The text says what is there instead.
            RequestError: there is no such state or signal.
        """
        holds, describe = self._condition(what, above, below)
        end = self.cycles + self._cycles_of(most)
        while not holds():
            if self.cycles >= end:
                raise AssertionError(f"not in {most:g} s: {describe()}. {self.situation()}")
            self.step()

    def _cycles_of(self, seconds: float) -> int:
        if not isfinite(seconds):
            raise RequestError("run", f"{seconds} s is no time", "Give a number of seconds")
        return round(seconds * 1e9 / self._lockstep.period)

    def _condition(
        self, what: str | Callable[[], object], above: float | None, below: float | None
    ) -> tuple[Callable[[], object], Callable[[], str]]:
        limits = [f"{word} {value:g}" for word, value in _bounds(above, below)]
        if callable(what):
            return what, lambda: f"{getattr(what, '__name__', what)} is true"
        if not limits:
            states = [state.name.lower() for state in State]
            if what not in states:
                remedy = f"{nearest(what, states)}. With a signal, say `above` or `below`"
                raise RequestError(f"until '{what}'", "it is no state", remedy)
            return lambda: self.state == what, lambda: f"state '{what}'"
        self._pick(what)  # a name that isn't there is told before anything runs

        def holds() -> bool:
            values = self[what]
            return bool((above is None or (values > above).all()) and (below is None or (values < below).all()))

        return holds, lambda: f"{what} {' and '.join(limits)} {self.unit(what)}; it is {self._words(what)}"

    # -- what a person or a client does

    def start(self) -> None:
        """Runs a cycle with a person's start (`srl start`)."""
        self._cycle(RequestKind.START)

    def stop(self) -> None:
        """Runs a cycle with a person's stop (`srl stop`)."""
        self._cycle(RequestKind.STOP)

    def reset(self) -> None:
        """Runs a cycle with a person's reset (`srl reset`)."""
        self._cycle(RequestKind.RESET)

    def setpoint(self, name: str, values: float | Sequence[float] | Array | None) -> None:
        """From the next cycle on, a client sends this setpoint in every cycle; None: it falls silent.

        Raises:
            RequestError: there is no such setpoint, or the values haven't its shape.
        """
        known = [entry["name"] for entry in self.layout.meta["setpoints"]]
        if name not in known:
            raise RequestError(f"setpoint '{name}'", "the profile has none of this name", nearest(name, known))
        if values is None:
            self._sent.pop(name, None)
            return
        given, shape = np.array(values, float), self.layout.fields[name].shape
        if given.ndim == 0 and len(shape) == 1:
            given = np.full(shape, given)
        if given.size != self.layout.fields[name].size:
            raise RequestError(
                f"setpoint '{name}'", f"the values are shaped {given.shape}", f"Give them shaped {shape}"
            )
        if not np.isfinite(given).all():
            raise RequestError(
                f"setpoint '{name}'", "the values aren't finite", "The runtime refuses such, too: give numbers"
            )
        self._sent[name] = given.reshape(shape)

    def set(self, parameter: str, value: float) -> None:
        """Changes a live parameter, as `srl set` does. Raises RequestError: it isn't there, or out of its bounds."""
        known = {entry["name"]: entry for entry in self.layout.meta["parameters"]}
        if parameter not in known:
            raise RequestError(f"parameter '{parameter}'", "it isn't there", nearest(parameter, known))
        lower, upper = known[parameter]["lower"], known[parameter]["upper"]
        if not lower <= value <= upper:
            problem = f"{value:g} is out of its bounds"
            raise RequestError(f"parameter '{parameter}'", problem, f"Give a number from {lower:g} to {upper:g}")
        self._graph.row.views[parameter][()] = value

    # -- faults

    def fault(self, device: str, kind: str, by: float = 0.0) -> None:
        """Begins a fault of a device: it lasts until `heal`, and ends the one it had.

        Args:
            device: its name in the profile.
            kind: one of `srl.runtime.testing.faults.FAULTS`, such as "silent".
            by: s, of "late" and "clock-jump".
        Raises:
            RequestError: there is no such device or fault, or this device can't have it.
        """
        self._device(device).begin(kind, by)

    def heal(self, device: str) -> None:
        """Ends the fault of a device. Raises RequestError: there is no such device."""
        self._device(device).end()

    def _device(self, name: str) -> FaultyDevice:
        if name not in self._faults:
            raise RequestError(f"device '{name}'", "the profile has none of this name", nearest(name, self._faults))
        return self._faults[name]

    # -- what is there

    @property
    def state(self) -> str:
        """The state after the newest cycle: "ready", "homing", "active", "stopping", "stopped"."""
        return State(self._word("state")).name.lower()

    @property
    def cause(self) -> str:
        """Why it stopped last, as docs/safety.md names it: "intent_loss", "device_loss"; "none" while it runs."""
        return Cause(self._word("cause")).name.lower()

    @property
    def fault_source(self) -> str:
        """The device, law or emergency input that it stopped for; "" for none."""
        return self.layout.fault_source(Cause(self._word("cause")), self._word("fault_source"))

    def connected(self, device: str) -> bool:
        """Whether its link was up in the newest cycle. Raises RequestError: there is no such device."""
        return bool(self._link(device) & LINK_CONNECTED)

    def stale(self, device: str) -> bool:
        """Whether its newest sample was older than `max_age` in the newest cycle. Raises RequestError."""
        return bool(self._link(device) & LINK_STALE)

    def _link(self, device: str) -> int:
        self._device(device)
        return int(self.layout.header(self._newest(), f"{device}.link"))

    @property
    def rows(self) -> NDArray[np.int64]:
        """`(cycles, width)`: every row so far, as a recording holds them."""
        return np.array(self._rows).reshape(-1, self.layout.width)

    def __getitem__(self, signal: str) -> Array:
        """The newest values of a signal, a copy in its shape; of one element, an array shaped ()."""
        return self._pick(signal)[-1]

    def history(self, signal: str) -> Array:
        """The values of a signal in every cycle so far, `(cycles, *shape)`."""
        self._pick(signal)
        return pick(self.layout, self.rows, signal, "history")

    def unit(self, signal: str) -> str:
        """A signal's unit."""
        return self.layout.fields[split(signal)[0]].unit

    def check(
        self,
        signal: str,
        near: float | Sequence[float] | Array | None = None,
        within: float = 0.0,
        *,
        above: float | None = None,
        below: float | None = None,
    ) -> None:
        """Asserts on the newest values of a signal. They must be finite.

        Args:
            signal: its name.
            near: what it should be, in its unit; one number for all elements, or one for each.
            within: the largest difference from `near`.
            above, below: bounds that every element must be within.
        Raises:
            AssertionError: says which elements are off, by name and in their unit, and what the run is doing.
        """
        values = np.atleast_1d(self[signal])
        unit = self.unit(signal)
        wrong, expected = ~np.isfinite(values), ["a number"]
        with np.errstate(invalid="ignore"):
            if near is not None:
                wanted = self._wanted(signal, near, values)
                wrong, expected = wrong | ~(abs(values - wanted) <= within), [f"{near} ± {within:g} {unit}"]
            for word, bound in _bounds(above, below):
                wrong = wrong | ((values <= bound) if word == "above" else (values >= bound))
                expected.append(f"{word} {bound:g} {unit}")
        if wrong.any():
            text = ", ".join(expected[1:] if len(expected) > 1 and near is None else expected)
            raise AssertionError(f"{signal} should be {text}; it is {self._words(signal, wrong)}. {self.situation()}")

    def _wanted(self, signal: str, near: float | Sequence[float] | Array, values: Array) -> Array:
        wanted = np.asarray(near, float)
        if wanted.ndim and wanted.shape != values.shape:
            problem = f"`near` is shaped {wanted.shape}, the signal {values.shape}"
            raise RequestError(f"check '{signal}'", problem, "Give one number, or one for each element")
        return np.broadcast_to(wanted, values.shape)

    def situation(self) -> str:
        """What the run is doing, in a sentence or two, for messages."""
        why = (
            f" ({self.cause}{f' of {self.fault_source}' if self.fault_source else ''})" if self.cause != "none" else ""
        )
        faults = "".join(f", {name} is {f.kind}" for name, f in self._faults.items() if f.kind)
        newest = f" Newest event: {self.events[-1].strip().splitlines()[-1]}" if self.events else ""
        return f"After {self.time:g} s: state {self.state}{why}{faults}.{newest}"

    def _words(self, signal: str, which: NDArray[np.bool_] | None = None) -> str:
        values = np.atleast_1d(self[signal]).ravel()
        shown = np.ones(values.size, bool) if which is None else which.ravel()
        names = element_names(self.layout, signal, values.size) if values.size > 1 else [""]
        found = [f"{n} {v:.6g}".strip() for n, v, show in zip(names, values, shown, strict=True) if show]
        more = f", and {len(found) - 8} more" if len(found) > 8 else ""
        return f"{', '.join(found[:8])}{more} {self.unit(signal)}"

    def _pick(self, signal: str) -> Array:
        """`(1, *shape)`: of the newest row."""
        name = split(signal)[0]
        if name not in self.layout.fields:
            raise RequestError(f"signal '{signal}'", "it isn't there", nearest(name, self.layout.fields))
        return pick(self.layout, self._newest()[None], signal, f"signal '{signal}'").copy()

    def _newest(self) -> NDArray[np.int64]:
        return self._rows[-1] if self._rows else self._graph.row.words

    def _word(self, name: str) -> int:
        return int(self._newest()[getattr(CYCLE, name)])

    def _cycle(self, kind: RequestKind) -> None:
        if self._closed:
            raise RequestError("step", "the run has ended", "Make a new one")
        self._lockstep.sense()
        for name, values in self._sent.items():
            self._graph.row.views[name][...] = values
            words = self._graph.row.devices[self.layout.devices.index(name.partition(".")[0])]
            words[DEVICE.stamp] = self._graph.row.ints[CYCLE.now]
            words[DEVICE.link] |= LINK_CONNECTED
            words[DEVICE.frames] += 1
        self._lockstep.act(kind)
        self._rows.append(self._graph.row.words.copy())


def _bounds(above: float | None, below: float | None) -> list[tuple[str, float]]:
    """Those that are given. Raises RequestError: one is NaN, beyond which nothing lies."""
    found = [(word, value) for word, value in (("above", above), ("below", below)) if value is not None]
    for word, value in found:
        if isnan(value):
            raise RequestError(f"`{word}`", "it is NaN", "Give a number in the signal's unit")
    return found
