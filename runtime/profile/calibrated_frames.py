"""Frames whose place in their parent a calibration file says: `frames.NAME.calibration`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from srl.runtime.contracts.errors import OptionError, ProfileError, SrlError, WiringError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.frames import FrameEntry
from srl.runtime.contracts.signals import Signal
from srl.runtime.models import record_file
from srl.runtime.models.mount_record import FrameRecord
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

Records = dict[str, FrameRecord]
"""By frame, what its file says."""
_ROOM: Final = 20.0  # m, as in `warnings`, which needs this module
_OTHERWISE: Final = "Make it with `srl calibrate PROFILE frames`, or name another"


def placed(profile: Profile, source: Source) -> tuple[dict[str, FrameEntry], dict[str, KeptFile], Records]:
    """The frames with what their files say, the files, and these as they were read.

    Raises:
        ProfileError: a file isn't there, was changed, or is of other frames or devices.
    """
    frames, files, records = dict(profile.frames), dict[str, KeptFile](), Records()
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
        records[name] = made
    return frames, files, records


def _other(made: FrameRecord, name: str, entry: FrameEntry, profile: Profile) -> Iterator[str]:
    """Why a file can't be this frame's."""
    if (made.frame, made.parent) != (name, entry.parent):
        yield f"it says where '{made.frame}' is in '{made.parent}', not '{name}' in '{entry.parent}'"
    for device, driver in made.drivers.items():
        if device not in profile.devices:
            yield f"it was measured with the device '{device}', which the profile doesn't have"
        elif (now := profile.devices[device].driver) != driver:
            yield f"it was measured with '{device}' by the driver '{driver}', now it is '{now}'"
        elif (was := made.serials.get(device)) and (serial := _serial(profile, device)) not in (None, was):
            yield f"it was measured with the {driver} of serial {was}, now '{device}' is {serial}"


def _serial(profile: Profile, device: str) -> str | None:
    """The serial number that a device's entry demands of it, if it does."""
    given = profile.devices[device].options.get("serial")
    return None if given is None else str(given)


def as_measured(source: Source, records: Records, signals: Mapping[str, Signal]) -> None:
    """Raises WiringError: a pose is given in another frame now than when a frame was calibrated with it."""
    for name, made in records.items():
        for signal, into in zip(made.signals, (made.parent, made.frame), strict=False):
            if signal in signals and (now := signals[signal].frame) != into:
                problem = f"it was measured with '{signal}' when that was given in '{into}'; now it is in '{now}'"
                raise WiringError(source.place(f"frames.{name}.calibration"), problem, "Calibrate this frame again")


def warnings(source: Source, records: Records, profile: Profile, simulated: Iterable[str]) -> list[str]:
    """Files that the simulation made, of frames between real devices; places that no room has; unknown devices."""
    made = []
    for name, record in records.items():
        place = source.place(f"frames.{name}.calibration")
        if record.simulated and (real := [device for device in record.drivers if device not in simulated]):
            text = f"it was made in simulation, and '{real[0]}' is real. It says nothing about a real one: calibrate"
            made.append(f"{place}: {text}")
        for device in record.drivers:
            was, serial = record.serials.get(device), _serial(profile, device)
            if was and serial is None:
                text = f"it is of the {record.drivers[device]} {was}. Write `serial`, so that another one is refused"
                made.append(f"{source.place(f'devices.{device}')}: {text}")
            elif serial and not was:
                text = f"it doesn't say of which {record.drivers[device]} it is, and '{device}' is {serial}"
                made.append(f"{place}: {text}")
        if (far := max(map(abs, profile.frames[name].position))) > _ROOM:
            made.append(f"{place}: it says that '{name}' is {far:g} m off. Are these millimetres?")
    return made
