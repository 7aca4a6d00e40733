"""The commands of commissioning (entry points `srl.commands`); their modules are loaded when they are asked for."""

from __future__ import annotations

import argparse
import importlib
from typing import Final

COMMANDS: Final = {
    "new": "writes a profile of your own, a package for your own device, or a control law in a file",
    "calibrate": "makes the calibration file of a person or a device",
    "jog": "moves one joint of a device while a key is held",
    "migrate": "writes the new names of options into a profile of an older version",
    "setup-servos": "gives servos from their box the ids, baud rate and directions of a profile, one after another",
    "find-port": "lists the serial ports, what each may be, and whether you may open it",
}
"""What each does, in one line."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], name: str) -> None:
    """Adds one command's parser."""
    module = importlib.import_module(f"srl.commissioning.cli.{name.replace('-', '_')}")
    module.add_parser(subparsers)
