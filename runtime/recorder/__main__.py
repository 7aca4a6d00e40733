"""`python -m srl.runtime.recorder RUN_FOLDER --out FILE.rrd`.

The supervisor starts it, and starts it again with the same arguments if it dies.

Exit codes: 0 if the merged recording is complete; 1 if it isn't yet, and the segments were kept (stderr says why);
2 if it isn't and another try would change nothing, or if the arguments are wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.child import FINAL, Ending

if TYPE_CHECKING:
    from srl.runtime.recorder.base import BaseRecorder


def main() -> int:
    """Runs the recorder. Told to end, even before it has begun, it saves what there is."""
    ending = Ending(interrupt=True)  # before the imports that take long
    parser = argparse.ArgumentParser(prog="python -m srl.runtime.recorder")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    try:
        from srl.runtime.ipc.run_folder import RunFolder

        return _recorder()(RunFolder(options.run_folder), options.out, ending).run()
    except SrlError as error:
        print(f"recorder: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:  # what began this recording had more installed
        print(f"recorder: {error.name} isn't installed here. {extras.remedy(error.name or '')}", file=sys.stderr)
        return FINAL


def _recorder() -> type[BaseRecorder]:
    """What records here: without rerun the rows go to files of a form of their own."""
    if find_spec("rerun") is None:
        from srl.runtime.recorder.plain import PlainRecorder

        return PlainRecorder
    from srl.runtime.recorder.process import Recorder

    return Recorder


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # all is written, and an orderly end of rerun and pyarrow takes 0.5 s
