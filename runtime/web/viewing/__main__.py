"""`python -m srl.runtime.web.viewing RUN_FOLDER`: shows a run live until it ends, and saves nothing.

The supervisor starts it, and starts it again if it dies. Exit codes: 0 at the run's end; 2 if there is no run, no port
or no viewer.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.run_folder import RunFolder

if TYPE_CHECKING:  # it imports rerun, which takes long
    from srl.runtime.web.viewing.feed import Feed


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
    from srl.runtime.web.viewing.assets import executable
    from srl.runtime.web.viewing.server import ViewerServer

    executable()  # raises what is missing before an address is printed
    server = ViewerServer(run)
    async with server.serving() as follower:
        _say(server.address())  # at once: the imports for its data take a second or two
        server.feed = feed = await asyncio.to_thread(_feed, run, ending)
        while not feed.over and not follower.done():
            await asyncio.sleep(0.05)
        if follower.done():
            follower.result()  # raises what it failed with
        if feed.failure is not None:
            raise feed.failure
        server.look()
        await server.last()


def _feed(run: RunFolder, ending: Ending) -> Feed:
    from srl.runtime.web.viewing.feed import Feed

    return Feed(run, ending)


def _say(text: str) -> None:
    # A terminal may have the run's status on this line, without an end: that line is begun anew.
    line = "\r\x1b[2K" if sys.stderr.isatty() else ""
    sys.stderr.write(f"{line}viewer: {text}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
