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
    try:
        from runtime.recorder.process import Recorder, watch

        run = RunFolder(options.run_folder)
        if options.out is None:
            return watch(run, ending)
        return Recorder(run, options.out, options.view, ending).run()
    except SrlError as error:
        print(f"recorder: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
