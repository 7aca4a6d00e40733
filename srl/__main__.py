"""`python -m srl` runs the command `srl`."""

import sys

from srl.runtime.cli import main

sys.exit(main())
