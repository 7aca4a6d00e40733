"""`python -m srl.runtime.web.foxglove RUN_FOLDER`: shows a run live to Foxglove's app until it ends.

The supervisor starts it, and starts it again if it dies. Exit codes: 0 at the run's end; 2 if there is no run or port.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from pathlib import Path

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.rows import Condition
from srl.runtime.ipc.run_folder import RunFolder


def main() -> int:
    """Shows the run."""
    ending = Ending(interrupt=True)  # before the imports that take long
    os.nice(5)  # a machine that is too slow for both keeps the loop
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.web.foxglove")
    parser.add_argument("run_folder", type=Path)
    options = parser.parse_args()
    try:
        asyncio.run(_show(RunFolder(options.run_folder), ending))
    except SrlError as error:
        _say(str(error))
        return 2
    return 0


async def _show(run: RunFolder, ending: Ending) -> None:
    from srl.runtime.web.foxglove.server import FoxgloveServer

    server = FoxgloveServer(run)
    async with server.serving() as follower:
        _say(f"{server.address}  (Foxglove: Open connection, Foxglove WebSocket)")
        while not follower.done():
            # Stopping a service signals all its processes, and the loop's own stop takes a while and is to be seen.
            silent = ending.asked and server.condition is Condition.SILENT
            if silent or server.condition is Condition.ENDED:
                break
            await asyncio.sleep(0.05)
        if follower.done():
            follower.result()  # raises what it failed with


def _say(text: str) -> None:
    print(f"foxglove: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
