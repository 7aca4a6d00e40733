"""`python -m srl.drivers.lsl DESCRIPTOR`, started by `srl.drivers.lsl.driver`."""

import sys

from srl.drivers.lsl.process import main

sys.exit(main(sys.argv[1:]))
