"""`srl list`: lists drivers, controllers, clearances and profiles, one line each."""

from __future__ import annotations

import argparse
import json
from typing import Any

from srl.runtime.cli import add_command, options
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import SrlError
from srl.runtime.profile import library


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "list", "srl list --json")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the lists. A part that can't be imported is listed with the reason."""
    content = {
        "drivers": _drivers(),
        "controllers": _summaries("controllers"),
        "clearances": _summaries("clearances"),
        "profiles": _profiles(),
    }
    if args.json:
        print(json.dumps(content))
        return 0
    for title, items in content.items():
        print(f"{title}:")
        for item in items:
            marks = [m for m in ("fake", "twin") if item.get(m)]
            print(f"  {item['name']:<18} {item['summary']}" + (f"  [{', '.join(marks)}]" if marks else ""))
    return 0


def _drivers() -> list[dict[str, Any]]:
    fakes, twins = registry.names("fakes"), registry.names("twins")
    found = []
    for name in registry.names("drivers"):
        item: dict[str, Any] = {"name": name, "fake": name in fakes, "twin": name in twins}
        try:
            described = registry.describe("drivers", name, ("summary", "gives", "takes"))
            item |= {"summary": described["summary"], "states": described["gives"], "commands": described["takes"]}
        except SrlError as error:
            item |= {"summary": str(error), "states": [], "commands": []}
        found.append(item)
    return found


def _summaries(group: str) -> list[dict[str, Any]]:
    found = []
    for name in registry.names(group):
        try:
            summary = registry.describe(group, name, ("summary",))["summary"]
        except SrlError as error:
            summary = str(error)
        found.append({"name": name, "summary": summary})
    return found


def _profiles() -> list[dict[str, Any]]:
    found = []
    for name in library.shipped():
        try:
            summary = library.summary(name)
            if summary is None:
                from srl.runtime.profile import profile

                summary = profile.load(name)[0].summary
        except SrlError as error:
            summary = str(error)
        found.append({"name": name, "summary": summary})
    return found
