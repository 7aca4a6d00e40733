"""`python -m runtime` runs the command `srl`."""

import sys

from runtime.cli import main

sys.exit(main())
