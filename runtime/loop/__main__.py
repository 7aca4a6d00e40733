"""`python -m runtime.loop RUN_FOLDER CHANNEL`, started by the supervisor."""

import os
import sys

from runtime.loop.process import main

code = main()
sys.stderr.flush()
# Garbage collection is frozen here: an orderly shutdown would only complain about what it can't free.
os._exit(code)
