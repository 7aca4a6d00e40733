"""`python -m runtime.loop RUN_FOLDER CHANNEL`, started by the supervisor."""

import os
import sys

from runtime.ipc.child import Ending

ending = Ending()  # before the imports that take long

from runtime.loop.process import main  # noqa: E402

code = main(ending)
sys.stderr.flush()
# Garbage collection is frozen here: an orderly shutdown would only complain about what it can't free.
os._exit(code)
