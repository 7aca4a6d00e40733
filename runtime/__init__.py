"""The SRL runtime: contracts, loop, guard, telemetry and command line."""

import os

if __name__ == "runtime":  # a second copy, from a checkout on the path
    raise ImportError("runtime is srl.runtime now: `import srl.runtime`", name="runtime")

# The loop must start no threads, and a sum split over threads differs in its last bits. This must be set
# before numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from srl import __version__ as __version__
