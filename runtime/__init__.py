"""The SRL runtime: contracts, loop, guard, telemetry and command line."""

import os

# The loop starts no threads, and a sum split over threads has other bits: before numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

__version__ = "0.1.0"
