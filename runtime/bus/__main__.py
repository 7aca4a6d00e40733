"""`python -m runtime.bus RUN_FOLDER`."""

import sys

from runtime.bus.process import main

sys.exit(main(sys.argv[1:]))
