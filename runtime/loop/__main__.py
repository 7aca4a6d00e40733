"""`python -m srl.runtime.loop RUN_FOLDER CHANNEL`, started by the supervisor."""

import os
import sys
from pathlib import Path

from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.control_end import ControlEnd

# Before what takes long, the imports and the devices: a stop that comes meanwhile waits there, and nothing moves after.
ending = Ending()
stops = ControlEnd(RunFolder(Path(sys.argv[1])).stop_socket)

from srl.runtime.loop.process import main  # noqa: E402

code = main(ending, stops)
sys.stderr.flush()
# Garbage collection is frozen here: an orderly shutdown would only complain about what it can't free.
os._exit(code)
