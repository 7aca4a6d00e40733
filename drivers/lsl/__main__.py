"""`python -m drivers.lsl DESCRIPTOR`, started by `drivers.lsl.driver`."""

import sys

from drivers.lsl.process import main

sys.exit(main(sys.argv[1:]))
