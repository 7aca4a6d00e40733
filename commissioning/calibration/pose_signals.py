"""The poses that a profile's devices measure, without opening or wiring anything."""

from __future__ import annotations

from pydantic import ValidationError

from srl.runtime.contracts.terms import POSE
from srl.runtime.models.models import context
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source, first_error


def pose_signals(checked: Profile, source: Source) -> dict[str, str | None]:
    """By name of each pose (7,), the frame in which it is given; None: its device doesn't say. Raises ProfileError."""
    found: dict[str, str | None] = {}
    for name, entry in checked.devices.items():
        path = f"devices.{name}"
        driver = source.load("drivers", entry.driver, f"{path}.driver")
        try:
            given = context(checked.models) | {"files": source.files}
            config = driver.Config.model_validate(entry.options, context=given)
        except ValidationError as error:
            raise first_error(error, source, path, driver.Config) from None
        found |= {f"{name}.{s.name}": s.frame for s in driver(name, config).states if s.labels == POSE}
    return found
