"""`srl doctor`: checks whether this host is fit for the requested rate."""

from __future__ import annotations

import argparse
import dataclasses
import json
from fractions import Fraction

from runtime.cli import add_command
from runtime.contracts.errors import RequestError
from runtime.profile import profile
from runtime.service.host import examine, python

_MARKS = {"good": "ok", "doubtful": "??", "bad": "!!"}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "doctor", "srl doctor sixth-finger")
    parser.add_argument("profile", nargs="?", help="take the rate and the ports from this profile")
    parser.add_argument("--rate", help="Hz; default: the profile's, else 100")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as for run")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the findings. Returns 0 if nothing is bad, else 1."""
    rate, ports = Fraction(100), {}
    if args.profile is not None:
        checked, _ = profile.load(args.profile, args.set)
        rate = checked.rate
        ports = {n: str(d.options["port"]) for n, d in checked.devices.items() if "port" in d.options}
    if args.rate is not None:
        try:
            rate = Fraction(args.rate)
        except (ValueError, ZeroDivisionError):
            rate = Fraction(0)
        if not 1 <= rate <= 10_000:
            raise RequestError("--rate", f"'{args.rate}' is no rate", "Give 1 to 10000 Hz")
    findings = list(examine(rate, ports))
    fit = all(f.verdict != "bad" for f in findings)
    if args.json:
        content = {"rate_hz": float(rate), "fit": fit, "findings": [dataclasses.asdict(f) for f in findings]}
        print(json.dumps(content))
    else:
        print(f"{python()}; for {float(rate):g} Hz:")
        for f in findings:
            print(f"  {_MARKS[f.verdict]}  {f.what}: {f.found}" + (f". {f.remedy}." if f.remedy else ""))
        print("fit" if fit else "not fit: mend what is marked !!")
    return 0 if fit else 1
