"""`python -m srl.runtime.web.operator RUN_FOLDER`: the process of the operator's panel."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator.server import OperatorServer
from srl.runtime.web.panel.process import run


def main() -> int:
    """Serves until the input ends. Exit code 2: the run or the port isn't there."""
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.web.operator")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--recordings", type=Path, default=Path())
    parser.add_argument("--port", type=int, default=0)
    options = parser.parse_args()
    return run(lambda: OperatorServer(RunFolder(options.run_folder), options.recordings), options.port)


if __name__ == "__main__":
    sys.exit(main())
