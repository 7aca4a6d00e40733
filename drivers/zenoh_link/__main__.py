"""`python -m srl.drivers.zenoh_link DESCRIPTOR`, started by `srl.drivers.zenoh_link.link`."""

import sys

from srl.drivers.zenoh_link.process import main

sys.exit(main(sys.argv[1:]))
