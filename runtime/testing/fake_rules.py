"""What every fake must do, beside its driver: one rule a function. Each raises AssertionError with what is wrong.

A fake comes with its world, so most rules take what makes a new pair: a rule that compares two runs needs two.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.runtime.contracts.world import Fake, World

STEP = 10_000_000  # ns of world time between two cycles
STEPS = 80

Make = Callable[[], tuple[World, Fake]]
"""Makes a new world, and in it a bound fake that isn't open."""


def is_the_same_device(fake: Fake, real: Driver) -> None:
    """It declares what its driver declares, so a profile means the same with and without `--sim`."""
    for what in ("states", "commands", "max_age", "summary"):
        mine, its = getattr(fake, what), getattr(real, what)
        assert mine == its, f"{_name(fake)}.{what} isn't {type(real).__name__}'s: {mine} and {its}"
    homes = sorted(fake.home), sorted(real.home)
    assert homes[0] == homes[1], f"{_name(fake)}.home isn't {type(real).__name__}'s: {homes[0]} and {homes[1]}"


def samples_are_fresh(make: Make) -> None:
    """Samples come, are finite and no older than `max_age`, and no stamp is in the future or goes back."""
    world, fake = make()
    name, before, now = _name(fake), -1, 0
    fake.open()
    assert fake.health.connected, f"{name} is open and says that it isn't connected"
    for now in range(STEP, (STEPS + 1) * STEP, STEP):
        world.advance(now)
        fake.read(now)
        stamp = fake.health.stamp
        assert stamp <= now, f"{name}: a sample of {stamp * 1e-9:g} s came at {now * 1e-9:g} s, before it was taken"
        assert stamp >= before, f"{name}: the stamp goes back, from {before * 1e-9:g} s to {stamp * 1e-9:g} s"
        before = stamp
    assert fake.health.fault == "", f"{name} has a fault of its own: {fake.health.fault}"
    if fake.states:
        assert fake.health.stamp >= 0, f"{name} gave no sample in {now * 1e-9:g} s: `health.stamp` was never set"
        age = (now - fake.health.stamp) * 1e-9
        assert age < fake.max_age, f"{name}: the newest sample is {age:g} s old, `max_age` is {fake.max_age:g} s"
        assert fake.health.frames > 0, f"{name} gives samples and counts none in `health.frames`"
        for state, values in fake.state_arrays.items():
            assert np.isfinite(values).all(), f"{name}.{state} isn't finite: {values}"
    fake.close()
    world.close()


def repeats_exactly(make: Make) -> None:
    """Two runs in the same world give the same bits: no clock, no randomness but one seeded by `world.seed`."""
    one, other = _run(make), _run(make)
    assert one == other, "a second run in the same world gives other bits: it has a clock or a chance of its own"


def _run(make: Make) -> list[bytes]:
    world, fake = make()
    fake.open()
    seen = []
    for now in range(STEP, (STEPS + 1) * STEP, STEP):
        world.advance(now)
        fake.read(now)
        seen.append(b"".join(values.tobytes() for values in fake.state_arrays.values()))
        seen.append(b"%d" % fake.health.stamp)
    fake.close()
    world.close()
    return seen


def can_be_closed_and_opened_again(make: Make) -> None:
    """Closed it is lost, and once more open it goes on; that counts as one reconnect. Stop and close come any time."""
    world, fake = make()
    name = _name(fake)
    fake.close()
    for what in (fake.read, fake.write) if fake.commands else (fake.read,):
        try:
            what(0)
        except DeviceLostError:
            continue
        raise AssertionError(f"{name} isn't open: {what.__name__} must raise DeviceLostError")
    fake.open()
    fake.stop(Stop.HOLD)
    fake.close()
    fake.close()
    assert not fake.health.connected, f"{name} is closed and says that it is connected"
    fake.open()
    assert fake.health.connected, f"{name} was opened again and says that it isn't connected"
    count = fake.health.reconnects
    assert count == 1, f"{name} was opened again, and `health.reconnects` is {count}: `open` calls `health.opened()`"
    world.advance(STEP)
    fake.read(STEP)
    fake.close()
    world.close()


def says_what_was_sent(make: Make) -> None:
    """A command that is written is in `sent_arrays`, by `write` or the next `read`; and no array was replaced."""
    world, fake = make()
    name, sent = _name(fake), dict(fake.sent_arrays)
    fake.open()
    for now in range(STEP, (STEPS + 1) * STEP, STEP):
        world.advance(now)
        fake.read(now)
        for command in fake.commands:
            start = fake.home.get(command.name)
            if command.feedback is not None and command.feedback in fake.state_arrays:
                start = fake.state_arrays[command.feedback]
            if start is not None and np.shape(start) == command.shape and command.kind == "position":
                fake.command_arrays[command.name][...] = start
        fake.write(now)
    for command in fake.commands:
        found = fake.sent_arrays[command.name]
        assert found is sent[command.name], f"{name} put another array into `sent_arrays`: fill it instead"
        assert np.isfinite(found).all(), f"{name} took '{command.name}', and `sent_arrays` doesn't say what left"
    fake.close()
    world.close()


def _name(fake: Fake) -> str:
    return type(fake).__name__
