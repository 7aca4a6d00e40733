"""The SRL runtime: contracts, loop, guard, telemetry and command line."""

import os

# The loop must start no threads, and a sum split over threads differs in its last bits. This must be set
# before numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

__version__ = "0.1.0"
