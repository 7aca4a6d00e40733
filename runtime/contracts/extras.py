"""Which part of srl-runtime a library comes with, and the command that installs it (docs/install.md)."""

from __future__ import annotations

import shlex
import sys
from typing import Final

PACKAGE: Final = "srl-runtime"
EXTRA_OF: Final = {
    "aiohttp": "panel",
    "cryptography": "panel",
    "daqp": "models",
    "distributed": "distributed",
    "eigenpy": "models",
    "example_robot_data": "meshes",
    "ezc3d": "c3d",
    "matplotlib": "view",
    "mcap": "mcap",
    "mujoco": "sim",
    "PIL": "view",
    "pinocchio": "models",
    "pyarrow": "view",
    "pylsl": "lsl",
    "pytest": "testing",
    "rerun": "view",
    "scipy": "models",
}
"""The extra of each library that isn't in every installation, by the name under which it is imported."""
WHERE_A_WHEEL_IS: Final = ("ruckig",)
"""Libraries that come with the package where they have a wheel, and can be built elsewhere."""


OLD: Final = ("runtime", "drivers", "sim", "studies", "profiles")
"""Packages that had these names until everything was imported from `srl`."""


def import_remedy(error: Exception) -> str:
    """What helps where a part or a command can't be imported."""
    missing = str(getattr(error, "name", None) or "") if isinstance(error, ImportError) else ""
    top = missing.partition(".")[0]
    if top in OLD:
        return f"It was written for an earlier {PACKAGE}: import 'srl.{missing}', or what 'srl' itself offers"
    if top == "srl":
        return f"It expects another version of {PACKAGE}. docs/extending.md says what a package imports"
    if not isinstance(error, ImportError):
        return "Mend that package, or uninstall it"
    return remedy(missing) or "Install what is missing into the runtime's environment"


def remedy(module: str) -> str:
    """What to type so that a module can be imported; "" if it is none of ours."""
    top = module.partition(".")[0]
    if top in WHERE_A_WHEEL_IS:
        what = top
    elif top in EXTRA_OF:
        what = f"{PACKAGE}[{EXTRA_OF[top]}]"
    else:
        return ""
    return f"Install it: {shlex.quote(sys.executable)} -m pip install {shlex.quote(what)}"
