"""The drivers that can move a limb of a URDF."""

from __future__ import annotations

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.limb_drives import LimbDrives


def limb_driver(name: str) -> LimbDrives:
    """How this driver moves a limb. Raises ProfileError or HostError: none has the name, or it can't be used."""
    place = f"--driver {name}"
    made = registry.load("limbs", name, place)
    if not (isinstance(made, type) and issubclass(made, LimbDrives)):
        raise HostError(place, "its entry point 'srl.limbs' is no LimbDrives", "Derive it from srl.LimbDrives")
    if made.driver != name:
        problem = f"its entry point 'srl.limbs' gives the driver '{made.driver}'"
        raise HostError(place, problem, f"Name the entry point {made.driver}, or set driver = '{name}'")
    return made()


def limb_drivers() -> dict[str, LimbDrives]:
    """All of them by name."""
    return {name: limb_driver(name) for name in registry.names("limbs")}
