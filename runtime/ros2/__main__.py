"""`python -m srl.runtime.ros2 RUN_FOLDER`."""

import sys

from srl.runtime.ipc.child import Ending

ending = Ending()  # before the imports that take long

from srl.runtime.ros2.process import main  # noqa: E402

sys.exit(main(sys.argv[1:], ending))
