"""What decides the results of a run bit for bit, besides its inputs: versions and the BLAS kernel in use."""

from __future__ import annotations

import ctypes
import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from srl.runtime import __version__

PACKAGES = ("numpy", "mujoco", "ruckig", "pin", "eclipse-zenoh", "rerun-sdk", "pyserial", "python-can")


def versions() -> dict[str, str]:
    """Versions that decide the results bit for bit: this package, Python, the numerical libraries."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    found = {"srl-runtime": __version__, "python": platform.python_version(), "platform": sys.platform}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def blas() -> str:
    """The BLAS kernel in use: different kernels give different bits."""
    # numpy's wheels contain OpenBLAS, which has a function that names the kernel it chose for this processor.
    for library in Path(np.__file__).parent.parent.glob("numpy.libs/*openblas*"):
        handle = ctypes.CDLL(str(library))
        for name in ("scipy_openblas_get_corename64_", "openblas_get_corename64_", "openblas_get_corename"):
            if hasattr(handle, name):
                function = getattr(handle, name)
                function.restype = ctypes.c_char_p
                return f"openblas {function().decode()}"
    return "unknown"
