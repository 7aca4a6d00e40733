"""`python -m srl.runtime.recorder RUN_FOLDER --out FILE.rrd`.

The supervisor starts it, and starts it again with the same arguments if it dies.

Exit codes: 0 if the merged recording is complete; 1 if it isn't yet, and the segments were kept (stderr says why);
2 if it isn't and another try would change nothing, or if the arguments are wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import Ending


def main() -> int:
    """Runs the recorder. Told to end, even before it has begun, it saves what there is."""
    ending = Ending(interrupt=True)  # before the imports that take long
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.recorder")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    try:
        from srl.runtime.ipc.run_folder import RunFolder
        from srl.runtime.recorder.process import Recorder

        return Recorder(RunFolder(options.run_folder), options.out, ending).run()
    except SrlError as error:
        print(f"recorder: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # all is written, and an orderly end of rerun and pyarrow takes 0.5 s
