"""`python -m runtime.recorder RUN_FOLDER --out FILE.rrd [--view]`; `--view` alone shows the run and saves nothing.

The supervisor starts it, and starts it again with the same arguments if it dies.

Exit codes: 0 if the merged recording is complete; 1 if it isn't, or if the segments were kept (stderr says why);
2 if the arguments are wrong.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from runtime.contracts.errors import SrlError
from runtime.ipc.child import Ending
from runtime.ipc.run_folder import RunFolder
from runtime.recorder.viewer_server import ViewerServer


def main() -> int:
    """Runs the recorder. Told to end, even before it has begun, it saves what there is."""
    ending = Ending(interrupt=True)  # before the imports that take long
    parser = argparse.ArgumentParser(prog="python -m runtime.recorder")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--view", action="store_true")
    options = parser.parse_args()
    if options.out is None and not options.view:
        parser.error("give --out, --view or both")
    server = _server() if options.view else None
    try:
        from runtime.recorder.process import Recorder, watch

        run = RunFolder(options.run_folder)
        if options.out is not None:
            return Recorder(run, options.out, server, ending).run()
        return watch(run, server, ending) if server is not None else 0
    except SrlError as error:
        print(f"recorder: {error}", file=sys.stderr)
        return 2
    finally:
        if server is not None:
            server.close()


def _server() -> ViewerServer | None:
    """Starts the viewer's server, and says its address at once: the imports for its data take a second or two."""
    try:
        server = ViewerServer()
    except SrlError as error:
        print(f"recorder: {error}", file=sys.stderr, flush=True)
        return None
    print(f"recorder: viewer: {server.url}", file=sys.stderr, flush=True)
    return server


if __name__ == "__main__":
    sys.exit(main())
