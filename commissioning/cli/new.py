"""`srl new`: writes a user's own profile, begun as one that comes with the runtime, and checks it.

`--urdf FILE` makes it of a limb's URDF instead (`srl.commissioning.cli.new_robot`).

`srl new device NAME` writes a package for a device instead (`srl.commissioning.cli.new_device`), `srl new law NAME` a
control law in a file (`srl.commissioning.cli.new_law`). The words `device` and `law` alone are profiles' names like any
other, where `--from` says what one begins as.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from srl.commissioning.cli import COMMANDS, new_ports
from srl.commissioning.new.template import begin, check_name
from srl.runtime.cli import add_command
from srl.runtime.cli.check import examine
from srl.runtime.contracts import registry, whole_file
from srl.runtime.contracts.errors import RequestError, SrlError, nearest
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.printable import printable
from srl.runtime.ipc import older
from srl.runtime.profile import profile
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.option_tree import options
from srl.runtime.profile.overrides import split

_OTHERS = {"device": "new_device", "law": "new_law"}  # what isn't a profile, and the module that writes it


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "new", "srl new my-finger --from sixth-finger --port finger=/dev/ttyACM1", COMMANDS
    )
    parser.add_argument(
        "name", metavar="NAME", help="the profile's own name: a-z, 0-9, - and _; or the word device or law"
    )
    parser.add_argument("device", nargs="?", metavar="DEVICE", help="after the word device or law: its own name")
    parser.add_argument(
        "--from", dest="template", metavar="PROFILE", help="begin as this one (srl list); left out: asks, on a terminal"
    )
    parser.add_argument("--urdf", metavar="FILE", help="begin as a limb with this URDF, in place of --from")
    parser.add_argument("--base", metavar="LINK", help="with --urdf: the link at the limb's base; default: the root")
    parser.add_argument("--tip", metavar="LINK", help="with --urdf: the link at the limb's end")
    parser.add_argument(
        "--driver",
        choices=registry.names("limbs"),
        help="with --urdf: what moves its joints; left out: asks, on a terminal",
    )  # fmt: skip
    parser.add_argument(
        "--split", nargs="+", metavar="DEVICE",
        help="with --from: these devices are at another computer; writes both halves, NAME being theirs",
    )  # fmt: skip
    parser.add_argument(
        "--host", action="append", default=[], metavar="HOST",
        help="with --split: a name or address of that computer, the first is connected to; none: all run on this one",
    )  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="write this value into it")
    parser.add_argument(
        "--port", action="append", default=[], metavar="DEVICE=PORT", help="a device's port (srl find-port lists them)"
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="default: NAME.yaml, here; a device's folder: srl-DEVICE; a law's: here",
    )
    parser.add_argument(
        "--yes", action="store_true", help="replace a file that is there; it is kept as FILE.old, FILE.old.2, ..."
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Writes the file, checks it and says what comes next. Returns 0; what is wrong is raised, and nothing written."""
    if args.device is not None:
        return _other(args)
    if args.name in _OTHERS and args.template is None:
        problem = f"it isn't said which {args.name}"
        remedy = f"Give its name; for a profile called {args.name}, say --from PROFILE"
        raise RequestError(f"srl new {args.name}", problem, remedy)
    check_name(args.name)
    if args.split:
        from srl.commissioning.cli import new_halves

        return new_halves.write(args)
    if args.host:
        raise RequestError("--host", "it is for --split", "Add --split DEVICE, or leave it out")
    target = _target(args)
    if args.urdf is not None:
        from srl.commissioning.cli import new_robot

        if args.template is not None:
            raise RequestError("--from", "--urdf says what the profile begins as", "Leave one of them out")
        ports = [f"devices.{device}.port={json.dumps(port)}" for device, port in map(_port, args.port)]
        return new_robot.write(args, target, [*args.set, *ports])
    if typed := next((option for option in ("base", "tip", "driver") if getattr(args, option) is not None), None):
        raise RequestError(f"--{typed}", "it is for a limb's URDF", "Give --urdf FILE, or leave it out")
    template, ports = args.template, list(args.port)
    if template is None:
        from srl.commissioning.cli import new_questions

        template = new_questions.template(args.name)
        ports += new_questions.ports(template, args.set, [_port(p)[0] for p in ports])
    overrides = [*args.set, *_ports(template, args.set, ports)]
    started = begin(template, args.name, _from_there(template, overrides, target.parent))
    examine(template, overrides)  # what `--set` says wrong is told before a file is written
    simulated, _ = examine(template, overrides, sim=[])
    kept = older.keep(target)
    made: list[Path] = []
    try:
        for name, content in started.beside.items():
            beside = target.with_name(name)
            if beside.exists():
                print(f"{beside}: was there already, and is used as it is")
            else:
                whole_file.write(beside, content, RequestError)
                made.append(beside)
        whole_file.write(target, started.text.encode(), RequestError)
        made.append(target)
        graph, _ = examine(str(target))
    except BaseException:  # what is beside may not fit; Ctrl-C
        for path in made:
            path.unlink(missing_ok=True)
        if kept is not None:
            kept.replace(target)
        raise
    for path in made[:-1]:
        print(f"{path}: what it needs of {template}")
    print(f"{target}: begun as {template}" + f"; the one before is {kept}" * (kept is not None))
    _tell(str(target), template, graph, simulated)
    return 0


def _other(args: argparse.Namespace) -> int:
    if args.name not in _OTHERS:
        problem = f"'{args.device}' is one name too many"
        remedy = "A name has no blanks; for a device's package: srl new device NAME; for a law: srl new law NAME"
        raise RequestError("NAME", problem, remedy)
    written: int = importlib.import_module(f"srl.commissioning.cli.{_OTHERS[args.name]}").write(args)
    return written


def _target(args: argparse.Namespace) -> Path:
    path = args.out or Path(f"{args.name}.yaml")
    if path.suffix not in (".yaml", ".yml") and not os.path.isdir(path):
        raise RequestError("-o", f"'{path}' doesn't end in .yaml", f"Name it like {path.with_suffix('.yaml')}")
    if os.path.islink(path):
        path = Path(os.path.realpath(path))  # the link stays
    older.check(path, "a file", args.yes, f"{path}/{args.name}.yaml")
    return Path(path)


def _ports(template: str, overrides: Sequence[str], ports: Sequence[str]) -> Iterator[str]:
    """What `--port` says, as overrides. Raises RequestError, ProfileError."""
    devices = profile.load(template, overrides)[0].devices if ports else {}
    for given in ports:
        device, port = _port(given)
        if device not in devices:
            raise RequestError(f"--port {given}", f"{template} has no device '{device}'", nearest(device, devices))
        driver = devices[device].driver
        if "port" not in registry.load("drivers", driver, f"--port {given}").Config.model_fields:
            raise RequestError(f"--port {given}", f"the driver '{driver}' has no port", "Leave it out")
        yield f"devices.{device}.port={json.dumps(port)}"


def _port(given: str) -> tuple[str, str]:
    device, _, port = given.partition("=")
    if not device or not port:
        raise RequestError(f"--port {given}", "expected DEVICE=PORT", "For example --port finger=/dev/ttyACM0")
    return device, port


def _from_there(template: str, overrides: Sequence[str], folder: Path) -> list[str]:
    """The overrides for a file in `folder`. A relative path that was typed begins here, one in a profile beside it."""
    if folder.absolute() == Path.cwd() or not overrides:
        return list(overrides)
    graph, _ = examine(template, overrides)
    judges = {name: cleared.clearance for name, cleared in graph.clearances.items()}
    found = {}
    for path, _, value in options(graph.profile, graph.devices, graph.controllers, graph.world, judges):
        file = value.path if isinstance(value, KeptFile) else value
        if isinstance(file, Path):
            found[path] = file
    made = []
    for override in overrides:
        path, text = split(override)
        typed = path in found and not text.strip().startswith(("/", "~"))
        there = f"{path}={json.dumps(os.path.relpath(found[path], folder.absolute()))}" if typed else override
        made.append(there)
    return made


def _tell(name: str, template: str, graph: Graph, simulated: Graph) -> None:
    """Says what the check found, and what comes next."""
    print(f"checked: {len(graph.devices)} devices, {len(graph.controllers)} controllers, as `srl check {name}` shows")
    for warning in dict.fromkeys([*graph.warnings, *simulated.warnings]):
        print(printable(f"  warning: {warning}"))
    for remark in new_ports.remarks(graph):
        print(printable(f"  {remark}"))
    if graph.actuators:
        words = f"{template}'s limb: compare them with yours before it moves (srl check --all)"
        print(f"  its limits, directions and ids are those of {words}")
    print("Next:")
    file = shlex.quote(name)
    for line in (
        f"srl run {file} --sim", *_calibrations(graph, file), f"srl doctor {file}", *_jogs(graph, name),
        f"srl run {file} --set start=manual",
    ):  # fmt: skip
        print(f"  {line}")


def _jogs(graph: Graph, name: str) -> Iterator[str]:
    """The commands that move each limb alone, which shows what no check can know: which joint is which, which way."""
    from srl.commissioning.jog.profile_subset import SPEED, subset

    names = {actuator.name: graph.devices[actuator.device].name for actuator in graph.actuators}
    several = len(set(names.values())) > 1
    for command, device in names.items():
        limits = graph.profile.guard.get(command)
        alone = [f"guard.{command}.clear=null"] if limits is not None and limits.clear is not None else []
        with contextlib.suppress(SrlError):  # such as one of torques
            subset(*profile.load(name, alone), device, SPEED, sim=None)
            line = f"srl jog {shlex.quote(name)}" + f" {device}" * several
            yield line + "".join(f" --set {each}  # nobody wears it or is near it" for each in alone)


def _calibrations(graph: Graph, file: str) -> Iterator[str]:
    """The commands that make the calibration files which the profile names."""
    from srl.commissioning.calibration.request import KINDS, CalibrationRequest
    from srl.commissioning.calibration.session import method_of

    used = {entry.use for entry in graph.profile.controllers}
    for kind in map(method_of, KINDS):
        if not kind.law or kind.law in used:
            try:
                if kind.named(CalibrationRequest(file, kind.name), graph.profile, graph.source) is None:
                    continue
            except SrlError:
                continue  # several laws, devices or frames of the kind, or none: the user says which
            yield f"srl calibrate {file} {kind.name}{' --person P07' * kind.personal} --yes"
