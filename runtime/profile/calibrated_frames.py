"""Frames whose place in their parent a calibration file says: `frames.NAME.calibration`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from runtime.contracts.errors import OptionError, ProfileError, SrlError
from runtime.contracts.files import KeptFile
from runtime.contracts.frames import FrameEntry
from runtime.control.mount.record import FrameRecord
from runtime.control.shared import record_file
from runtime.profile.profile import Profile
from runtime.profile.source import Source

Simulated = dict[str, tuple[str, ...]]
"""By frame, the devices with which it was calibrated in simulation."""
_OTHERWISE: Final = "Make it with `srl calibrate PROFILE frames`, or name another"


def placed(profile: Profile, source: Source) -> tuple[dict[str, FrameEntry], dict[str, KeptFile], Simulated]:
    """The frames with what their files say, the files, and which of these were made in simulation.

    Raises:
        ProfileError: a file isn't there, was changed, or is of other frames or devices.
    """
    frames, files, simulated = dict(profile.frames), dict[str, KeptFile](), Simulated()
    for name, entry in profile.frames.items():
        if entry.calibration is None:
            continue
        place = source.place(f"frames.{name}.calibration")
        given = entry.calibration
        try:
            file = given if isinstance(given, KeptFile) else source.files.keep(given, _OTHERWISE)
            made = record_file.parse(FrameRecord, file.content, str(file.path))
        except OptionError as error:
            raise ProfileError(place, error.problem, error.remedy) from None
        except SrlError as error:
            raise ProfileError(place, f"{error.place}: {error.problem}", error.remedy) from None
        for problem in _other(made, name, entry, profile):
            raise ProfileError(place, problem, "Calibrate this frame, or name its own file")
        pose = {"position": made.pose.position, "quaternion": made.pose.quaternion}
        frames[name] = entry.model_copy(update={**pose, "calibration": None})
        files[name] = file
        if made.simulated:
            simulated[name] = tuple(made.drivers)
    return frames, files, simulated


def _other(made: FrameRecord, name: str, entry: FrameEntry, profile: Profile) -> Iterator[str]:
    """Why a file can't be this frame's."""
    if (made.frame, made.parent) != (name, entry.parent):
        yield f"it says where '{made.frame}' is in '{made.parent}', not '{name}' in '{entry.parent}'"
    for device, driver in made.drivers.items():
        if device not in profile.devices:
            yield f"it was measured with the device '{device}', which the profile doesn't have"
        elif (now := profile.devices[device].driver) != driver:
            yield f"it was measured with '{device}' by the driver '{driver}', now it is '{now}'"


def doubts(source: Source, found: Simulated, simulated: Iterable[str]) -> list[str]:
    """Files that the simulation made, of frames between real devices."""
    made = []
    for name, devices in found.items():
        if real := [device for device in devices if device not in simulated]:
            text = f"it was made in simulation, and '{real[0]}' is real. It says nothing about a real one: calibrate"
            made.append(f"{source.place(f'frames.{name}.calibration')}: {text}")
    return made
