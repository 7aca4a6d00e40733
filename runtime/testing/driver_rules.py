"""What every driver must declare before `open`, and how it behaves while it is closed: one rule a function.

Each takes a bound driver that isn't open, and raises AssertionError with a text that says what is wrong.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop
from srl.runtime.contracts.terms import POSITION_OF
from srl.runtime.testing.bound import bound


def describes_itself(driver: Driver) -> None:
    """`srl list` has a line of text for it."""
    assert driver.summary, f"{_name(driver)}: `srl list` wants a line of text in `summary`"


def declares_signals(driver: Driver) -> None:
    """It has states or commands; samples have an age; each element has a name."""
    name = _name(driver)
    assert driver.states or driver.commands, f"{name} declares neither states nor commands"
    assert not driver.states or driver.max_age > 0, f"{name} gives samples, so `max_age` must say when they are stale"
    for signal in (*driver.states, *driver.commands):
        assert not (fault := signal.naming_fault()), f"{name}.{signal.name}: {fault}"


def says_what_it_gives_and_takes(driver: Driver) -> None:
    """`gives` and `takes`, which `srl list` shows, have the names of all states and commands."""
    for what, names, signals in (
        ("gives", driver.gives, driver.states),
        ("takes", driver.takes, driver.commands),
    ):
        # <segment> stands for a name that the profile chooses
        patterns = [re.compile(re.sub("<[a-z]+>", "[a-z0-9_-]+", n.replace(".", "[.]"))) for n in names]
        for signal in signals:
            known = any(pattern.fullmatch(signal.name) for pattern in patterns)
            assert known, f"{_name(driver)}: `{what}` lacks '{signal.name}', so `srl list` doesn't show it"


def can_be_stopped(driver: Driver) -> None:
    """Each command says how it stops, how often it leaves, and where the limb is at the start."""
    name, states = _name(driver), {s.name: s for s in driver.states}
    for command in driver.commands:
        assert command.stops, f"{name}.{command.name} can't be stopped: `stops` is empty"
        assert command.period, f"{name}.{command.name} declares no `period`: how often does a command leave?"
        if command.kind is Kind.INTENSITY:
            assert command.stops == (Stop.OFF,), f"{name}.{command.name} is an intensity: its only stop is `off`"
        elif command.feedback is None:
            assert command.name in driver.home, f"{name}.{command.name} has no feedback, so it needs a `home`"
        else:
            measured = states.get(command.feedback)
            assert measured is not None, f"{name}.{command.name}: there is no state '{command.feedback}'"
            assert measured.shape == command.shape, f"{name}.{command.name} and its feedback differ in shape"
            elements, planar = set(measured.names), {POSITION_OF.get(n, n) for n in command.names}
            same = command.size == 1 or elements in (set(command.names), planar)
            assert same, f"{name}.{command.name} and its feedback differ in the names of their elements"


def is_harmless_while_closed(driver: Driver) -> None:
    """Stop and close may come at any time, more than once; there is nothing that a supervisor could send to."""
    name = _name(driver)
    driver.close()
    driver.stop(Stop.HOLD)
    frames = driver.stop_frames(Stop.HOLD)
    whole = isinstance(frames, tuple) and all(isinstance(frame, bytes) for frame in frames)
    assert whole, f"{name}.stop_frames must give a tuple of bytes"
    assert driver.fileno() in (None, -1), f"{name} isn't open and has a descriptor"
    driver.close()
    assert not driver.health.connected, f"{name} is closed and says that it is connected"


def is_lost_while_closed(driver: Driver) -> None:
    """Who reads it, or writes to it, is told that it is lost."""
    for what in (driver.read, driver.write) if driver.commands else (driver.read,):
        try:
            what(time.monotonic_ns())
        except DeviceLostError:
            continue
        raise AssertionError(f"{_name(driver)} isn't open: {what.__name__} must raise DeviceLostError")


def says_who_is_missing(driver: Driver) -> None:
    """`open` of a device that isn't there is an error with place and remedy, and leaves nothing open.

    The driver's options name a port where nobody answers.
    """
    name, error = _name(driver), None
    try:
        driver.open()
    except DeviceError as raised:
        error = raised
    finally:
        connected, reconnects = driver.health.connected, driver.health.reconnects
        driver.close()
    assert error is not None, f"{name}.open must raise DeviceError where nobody answers"
    assert driver.name in error.place, f"{name}.open: the error's place '{error.place}' lacks '{driver.name}'"
    for what, text in (("problem", error.problem), ("remedy", error.remedy)):
        assert len(text) > 10, f"{name}.open: the error's {what} '{text}' tells nobody anything"
    assert not connected, f"{name}.open has failed, and it says that it is connected"
    assert reconnects == 0, f"{name}.open has failed, and it counts a reconnect"


RULES: tuple[Callable[[Driver], None], ...] = (
    *(describes_itself, declares_signals, can_be_stopped),
    *(is_harmless_while_closed, is_lost_while_closed, says_what_it_gives_and_takes),
)
"""The rules that need no port."""


def check_driver(driver: Driver) -> None:
    """Puts to a driver the rules that need no port; `DriverConformance` has more.

    The driver must not be open.

    Raises:
        AssertionError: its text says what is wrong.
    """
    bound(driver)
    for rule in RULES:
        rule(driver)


def _name(driver: Driver) -> str:
    return type(driver).__name__
