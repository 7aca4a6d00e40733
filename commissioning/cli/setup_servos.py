"""`srl setup-servos`: gives servos from their box the ids, baud rate and directions of a profile, one after another."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from srl.commissioning.cli import COMMANDS
from srl.commissioning.new.lerobot import overrides
from srl.runtime.cli import add_command, options
from srl.runtime.contracts import whole_file
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, ProfileError, RequestError, SrlError, nearest
from srl.runtime.ipc import older
from srl.runtime.profile import profile
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.edit import edited
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "setup-servos", "srl setup-servos my-arm.yaml", COMMANDS)
    options.profile(parser)
    parser.add_argument("device", nargs="?", help="default: the only one whose servos can be set up")
    parser.add_argument("--only", nargs="+", metavar="MOTOR", help="these motors alone, in this order")
    parser.add_argument(
        "--limits", action="store_true", help="write the profile's lower and upper into the servos, too"
    )
    parser.add_argument(
        "--test", action="store_true", help="set up nothing: only look whether the servos are as the profile says"
    )
    parser.add_argument(
        "--lerobot", type=Path, metavar="FILE.json",
        help="set up nothing: write ids, offsets and bounds of a calibration of LeRobot into the profile",
    )  # fmt: skip
    options.overrides(parser)
    options.as_json(parser, "what was changed, as one JSON object at the end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Leads through all motors, then looks whether bus and profile agree. Returns 0 if they do, 1 if not."""
    checked, source = profile.load(args.profile, args.set)
    name, driver, config = _device(checked, source, args.device)
    if args.lerobot is not None:
        return _read(args, name, config)
    motors = list(config.motors)
    for motor in args.only or ():
        if motor not in motors:
            raise RequestError(f"--only {motor}", f"'{name}' has no motor '{motor}'", nearest(motor, motors))
    changed: dict[str, list[str]] = {}
    if not args.test:
        setter = driver.new_servo(config, name)  # type: ignore[attr-defined]
        for motor in args.only or motors:
            others = [name for name, changes in changed.items() if changes]  # a new servo isn't as these are
            done = _one(setter, motor, config.motors[motor], args.limits, others)
            if done is not None:
                changed[motor] = done
        _ask(f"Connect all of '{name}' to the adapter again, with power")
    if args.test and "configure" in type(config).model_fields:
        config = config.model_copy(update={"configure": False})
    problem = _problem(driver, name, config)
    if args.json:
        print(json.dumps({"device": name, "changed": changed, "problem": problem}))
    else:
        print(
            problem
            or f"{name}: all {len(motors)} servos are there, and as the profile says. Next: srl jog {args.profile}"
        )
    return 1 if problem else 0


def _read(args: argparse.Namespace, name: str, config: Any) -> int:
    """Writes what a calibration of LeRobot says into the profile, which is kept as it was, too."""
    path = Path(args.profile)
    if not path.is_file():
        problem = f"'{args.profile}' is no file of yours"
        raise RequestError("--lerobot", problem, f"srl new my-arm --from {args.profile}")
    label, text, _ = profile.find(str(path.absolute()))
    if config.driver != "feetech":
        problem = f"'{name}' has no Feetech servos, of which its counts are"
        raise RequestError("--lerobot", problem, "Name another device")
    changed = edited(label, text, overrides(args.lerobot, name, config))
    _device(*profile.parse(label, changed), name)
    kept = older.keep(path)
    whole_file.write(path, changed.encode(), RequestError)
    if args.json:
        print(json.dumps({"device": name, "kept": str(kept)}))
    else:
        print(f"{path}: '{name}' has the ids, offsets and bounds of {args.lerobot}; it was as {kept} is")
    return 0


def _one(setter: Any, name: str, motor: Any, limits: bool, others: list[str]) -> list[str] | None:
    """Sets up one motor; None: it was left out. `others`: those that were set up before."""
    while True:
        said = _ask(f"Connect the servo for '{name}' alone ({motor.model}, to be id {motor.id}). s leaves it out")
        if said == "s":
            return None
        try:
            found = setter.find()
            for other in others:
                if setter.config.motors[other].model == motor.model and setter.fits(other, found):
                    problem = f"this is the servo for '{other}', which was set up before"
                    raise DeviceError(setter.place, problem, f"Connect the one for '{name}'")
            changes = [str(change) for change in setter.give(name, found, limits)]
        except DeviceError as error:
            print(f"{error}", file=sys.stderr, flush=True)
            continue
        print(f"{name}: {', '.join(changes) or 'is as the profile says'}", file=sys.stderr, flush=True)
        return changes


def _ask(text: str) -> str:
    """What is typed after a question; "" for Enter. Raises RequestError: nothing is typed any more."""
    print(f"{text}. Enter goes on, q ends: ", end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline() if sys.stdin is not None else ""
    word = line.strip()
    if not line or word == "q":
        print(file=sys.stderr)
        raise RequestError("setup-servos", "it was ended before the last servo", "What is set up stays so; begin again")
    return word


def _problem(driver: type[Driver], name: str, config: Any) -> str:
    """Why the driver wouldn't run with these servos; "" for nothing. It moves nothing and switches no torque."""
    device = driver(name, config)
    try:
        device.open()
    except SrlError as error:
        return str(error)
    finally:
        device.close()
    return device.health.fault


def _device(checked: Profile, source: Source, asked: str | None) -> tuple[str, type[Driver], Any]:
    """The device's name, driver and options. Raises SrlError: there is none, or several."""
    able = dict(_able(checked, source))
    if asked is not None and asked not in checked.devices:
        raise RequestError(source.label, f"the profile has no device '{asked}'", nearest(asked, checked.devices))
    name = asked or (next(iter(able)) if len(able) == 1 else "")
    if name not in able:
        which = f"'{asked}' has no servos that can be set up" if asked else f"{len(able)} devices have servos to set up"
        raise ProfileError(source.place("devices"), which, f"Name one of: {', '.join(able) or 'none in this profile'}")
    parts = Builder(checked, source, None)
    entry, path = checked.devices[name], f"devices.{name}"
    return name, able[name], parts.options(able[name].Config, entry.options, path)


def _able(checked: Profile, source: Source) -> Iterator[tuple[str, type[Driver]]]:
    for name, entry in checked.devices.items():
        driver = source.load("drivers", entry.driver, f"devices.{name}.driver")
        if hasattr(driver, "new_servo"):
            yield name, driver
