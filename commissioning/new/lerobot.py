"""A calibration file of LeRobot for a bus of Feetech servos, as overrides of a profile.

LeRobot keeps one JSON object: for each motor its id, drive_mode, homing_offset (written into the servo), range_min and
range_max (counts that the servo reported while the joint was moved by hand). Source: LeRobot's `MotorCalibration`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from srl.drivers.servo_bus.models import CENTRE, PER_COUNT
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.validation import refusal


class Motor(BaseModel):
    """One motor's line."""

    model_config = ConfigDict(extra="forbid", strict=True)

    id: int = Field(ge=0, le=252)
    drive_mode: int = Field(ge=0, le=0)
    homing_offset: int = Field(ge=-2047, le=2047)
    range_min: int = Field(ge=0, le=4095)
    range_max: int = Field(ge=0, le=4095)


def overrides(path: Path, name: str, config: Any) -> list[str]:
    """The `--set` options that give the device `name` what the file says: ids, offsets, bounds.

    Args:
        path: of the file.
        name, config: the device and its options, in whose directions and zeros the bounds are.
    Raises:
        RequestError: it can't be read, or isn't of this device's motors.
    """
    try:
        found = TypeAdapter(dict[str, Motor]).validate_json(path.read_bytes())
    except OSError as error:
        raise RequestError(f"--lerobot {path}", f"can't be read: {error.strerror}", "Name another file") from None
    except ValidationError as error:
        first = refusal(error)
        problem = f"isn't a calibration of LeRobot: {first.path or 'the file'}: {first.problem}"
        raise RequestError(f"--lerobot {path}", problem, "Name the JSON that lerobot-calibrate wrote") from None
    if set(found) != set(config.motors):
        ours, theirs = ", ".join(config.motors), ", ".join(found)
        raise RequestError(f"--lerobot {path}", f"it is of {theirs}; '{name}' has {ours}", "Name the motors alike")
    given: list[str] = []
    for motor, line in found.items():
        if not line.range_min < line.range_max:
            raise RequestError(f"--lerobot {path}", f"the range of '{motor}' is empty", "Calibrate it again")
        axis, place = config.motors[motor], f"devices.{name}.motors.{motor}"
        ends = sorted(((n - CENTRE) * PER_COUNT - axis.zero) * axis.scale for n in (line.range_min, line.range_max))
        values = {"id": line.id, "offset": line.homing_offset, "lower": round(ends[0], 6), "upper": round(ends[1], 6)}
        given += [f"{place}.{key}={json.dumps(value)}" for key, value in values.items()]
    return given
