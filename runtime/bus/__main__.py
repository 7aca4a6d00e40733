"""`python -m srl.runtime.bus RUN_FOLDER`."""

import sys

from srl.runtime.ipc.child import Ending

ending = Ending()  # before the imports that take long

from srl.runtime.bus.process import main  # noqa: E402

sys.exit(main(sys.argv[1:], ending))
