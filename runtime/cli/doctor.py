"""`srl doctor`: checks whether this host is fit for a profile, and says what mends it."""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import json
import shlex
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from srl.runtime.cli import add_command, calibrations, options
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.ipc.ring import file_size
from srl.runtime.loop.process import rows_kept
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.source import Source
from srl.runtime.service.fitness.finding import Finding
from srl.runtime.service.host import Wanted, examine, python
from srl.runtime.service.supervisor import state_dir

_MARKS = {"good": "ok", "doubtful": "??", "bad": "!!"}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "doctor", "srl doctor sixth-finger")
    options.profile(parser, needed=False, text="take the rate, the ports and all else from this profile")
    parser.add_argument("--rate", metavar="HZ", help="of the loop; default: the profile's, else 100")
    parser.add_argument("--recordings", type=Path, default=Path(), metavar="FOLDER", help="where recordings go")
    options.overrides(parser)
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the findings. Returns 0 if nothing is bad, else 1."""
    rate = None if args.rate is None else _rate(args.rate)
    wanted = Wanted(rate or Fraction(100), state_dir("doctor"), args.recordings.expanduser().absolute())
    findings = list[Finding]()
    if args.profile is not None:
        wanted, of_profile = _of(args.profile, args.set, wanted, rate)
        findings += of_profile
    findings += examine(wanted)
    fit = all(f.verdict != "bad" for f in findings)
    if args.json:
        content = {"rate_hz": float(wanted.rate), "fit": fit, "findings": [dataclasses.asdict(f) for f in findings]}
        print(json.dumps(content))
    else:
        print(f"{python()}; for {float(wanted.rate):g} Hz:")
        for f in findings:
            remedy = f". {f.remedy}" + (":" if f.command else "." * (f.remedy[-1:] != ".")) if f.remedy else ""
            print(f"  {_MARKS[f.verdict]}  {f.what}: {f.found}{remedy}")
            if f.command:
                print(f"      $ {f.command}")
        print("fit" if fit else "not fit: mend what is marked !!")
    return 0 if fit else 1


def _rate(text: str) -> Fraction:
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 1 <= rate <= 10_000:
        raise RequestError("--rate", f"'{text}' is no rate", "Give 1 to 10000 Hz")
    return rate


def _of(name: str, overrides: list[str], wanted: Wanted, rate: Fraction | None) -> tuple[Wanted, list[Finding]]:
    """What a profile asks of the host, and what is found of the profile itself and its files. Raises ProfileError."""
    checked, source = profile.load(name, overrides)
    ports, inputs = _ports(checked, source)
    wanted = dataclasses.replace(
        wanted,
        rate=rate or checked.rate,
        state=state_dir(checked.name),
        ports=ports,
        inputs=inputs,
        listens=checked.bus.listen if checked.bus is not None else (),
    )
    findings = [*_certificates(checked)]
    words = shlex.join([name, *(word for override in overrides for word in ("--set", override))])
    try:
        graph = wiring.build(checked, source)
    except SrlError as error:  # a calibration that isn't there, for one: the host is looked at all the same
        finding = Finding("profile", "bad", f"{error.place}: {error.problem}", error.remedy, f"srl check {words}")
        return wanted, [finding, *findings]
    buses = {d.traffic.bus: d.traffic.bitrate for d in graph.devices if d.traffic is not None}
    rows = file_size(graph.layout.width, rows_kept(wanted.rate))
    of_files = calibrations.warnings(source.files.kept, datetime.date.today())
    findings += [
        Finding("profile", "doubtful", warning, "See the whole profile as checked", f"srl check {words}")
        for warning in (*graph.warnings, *of_files)
    ]
    return dataclasses.replace(wanted, buses=buses, rows=rows), findings


def _ports(checked: profile.Profile, source: Source) -> tuple[dict[str, str], dict[str, str]]:
    """The ports by device, and apart from them those of the kernel's input devices."""
    ports, inputs = dict[str, str](), dict[str, str]()
    for name, entry in checked.devices.items():
        cls = registry.load("drivers", entry.driver, source.place(f"devices.{name}.driver"))
        default = cls.Config.model_fields["port"].default if "port" in cls.Config.model_fields else None
        port = entry.options.get("port", default)
        if port in cls.among_inputs or str(port).startswith("/dev/input/"):
            inputs[name] = str(port)
        elif "port" in entry.options:
            ports[name] = str(port)
    return ports, inputs


def _certificates(checked: profile.Profile) -> Iterator[Finding]:
    tls = checked.bus.tls if checked.bus is not None else None
    if tls is None:
        return
    from srl.runtime.bus.certificate_warnings import warnings

    found = list(warnings(tls))
    for warning in found:
        yield Finding(
            "certificates of the bus",
            "bad" if warning.bad else "doubtful",
            warning.problem,
            warning.remedy,
            warning.command,
        )
    if not found:
        yield Finding("certificates of the bus", "good", tls.certificate)
