"""`python -m srl.runtime.web.viewing RUN_FOLDER`: the operator's panel of a run, until it ends (`srl run --view`).

The supervisor starts it, and starts it again if it dies. Exit codes: 0 at the run's end; 2 if there is no run, or no
port.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from pathlib import Path

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.run_folder import RunFolder

POLL = 0.05  # s between looks whether the run has ended
LAST = 0.3  # s that the pages get to show the run's last row


def main() -> int:
    """Shows the run. Told to end, it does so once the loop is silent."""
    ending = Ending(interrupt=True)  # before the imports that take long
    os.nice(5)  # a machine that is too slow for both keeps the loop
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.web.viewing")
    parser.add_argument("run_folder", type=Path)
    options = parser.parse_args()
    try:
        asyncio.run(_show(RunFolder(options.run_folder), ending))
    except SrlError as error:
        _say(str(error))
        return 2
    return 0


async def _show(run: RunFolder, ending: Ending) -> None:
    from srl.runtime.web.operator.server import OperatorServer

    server = OperatorServer(run, Path())
    async with server.serving() as follower:
        _say(server.address())
        while not follower.done() and not (server.over or (ending.asked and server.silent)):
            await asyncio.sleep(POLL)
        if follower.done():
            follower.result()  # raises what it failed with
        await asyncio.sleep(LAST)


def _say(text: str) -> None:
    # A terminal may have the run's status on this line, without an end: that line is started anew.
    line = "\r\x1b[2K" if sys.stderr.isatty() else ""
    sys.stderr.write(f"{line}viewer: {text}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
