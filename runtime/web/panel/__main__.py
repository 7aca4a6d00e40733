"""`python -m srl.runtime.web.panel RUN_FOLDER --signal SIGNAL`: the process of the participant's screen."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.process import run
from srl.runtime.web.panel.server import Server
from srl.runtime.web.panel.source import Source


def main() -> int:
    """Serves until the input ends. Exit code 2: the signal, the run or the port isn't there."""
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.web.panel")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--signal", required=True)
    parser.add_argument("--span", type=float, nargs=2, default=(0.0, 1.0))
    parser.add_argument("--held")
    parser.add_argument("--port", type=int, default=0)
    options = parser.parse_args()
    folder = RunFolder(options.run_folder)

    def made() -> Server:
        return Server(folder, Source(folder, options.signal, tuple(options.span), options.held))

    return run(made, options.port)


if __name__ == "__main__":
    sys.exit(main())
