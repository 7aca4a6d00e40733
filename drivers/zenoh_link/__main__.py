"""`python -m drivers.zenoh_link DESCRIPTOR`, started by `drivers.zenoh_link.link`."""

import sys

from drivers.zenoh_link.process import main

sys.exit(main(sys.argv[1:]))
