"""`python -m runtime.bus RUNDIR`."""

import sys

from runtime.bus.process import main

sys.exit(main(sys.argv[1:]))
