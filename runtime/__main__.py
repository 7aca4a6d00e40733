"""`python -m runtime` is the command `srl`."""

import sys

from runtime.cli import main

sys.exit(main())
