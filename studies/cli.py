"""The command `srl study` (entry point `srl.commands`); its module is loaded when it is asked for."""

from __future__ import annotations

import argparse
import importlib
from typing import Final

COMMANDS: Final = {"study": "runs a paper's experiment"}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], name: str) -> None:
    """Adds the command's parser."""
    importlib.import_module("srl.studies.command").add_parser(subparsers)
