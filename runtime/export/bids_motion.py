"""A recording as BIDS-Motion: one tracking system a device, in a data set of several persons and runs.

Source: the Brain Imaging Data Structure, version 1.10.0, "Motion". A data set's folder is made or added to. The states
of each device become channels: positions, orientations, velocities, joint angles by the specification's keywords, all
others as MISC. Each row of the loop is a sample, with its time as a channel LATENCY. Units are as recorded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import isnan
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime import __version__
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import POINT, QUATERNION
from srl.runtime.export.report import Report, listed, whole_file
from srl.runtime.recording.elements import Element, elements
from srl.runtime.recording.reader import Recording

VERSION: Final = "1.10.0"
COMPONENTS: Final = dict(zip(QUATERNION, ("quat_w", "quat_x", "quat_y", "quat_z"), strict=True))
# Of a velocity's elements: the keyword of the type, by the element's first letter.
RATES: Final = {"v": "VEL", "w": "GYRO"}
COLUMNS: Final = ("name", "component", "type", "tracked_point", "units", "reference_frame")
TYPES: Final = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL")
UNKNOWN: Final = (  # recommended by the specification, and in no recording: for the lab to fill in
    "Manufacturer", "ManufacturersModelName", "DeviceSerialNumber", "InstitutionName", "InstitutionAddress",
    "InstitutionalDepartmentName", "Instructions",
)  # fmt: skip
NONE: Final = "n/a"
DEVICE: Final = "device"  # the reference frame of coordinates whose frame the recording doesn't say

ABOUT: Final = """Runs of supernumerary robotic limbs, exported from recordings by srl-runtime.

A tracking system is a device of the run's profile. Each row of its motion file is a cycle of the control loop; the
channel `latency` has the cycle's time from the first row, and `age` how old the device's sample was. Units are SI,
angles are in rad, orientations are unit quaternions. `reference_frame` names a frame of the profile; the channels'
sidecar describes it. The events are the messages of the runtime and their times.

Fill in what only you know: authors and license in `dataset_description.json`, what is `n/a` in the sidecars, and here
who took part, what they did, and who may use the data.
"""


@dataclass(frozen=True)
class Channel:
    """A column of a motion file; the attributes are those of the channels file."""

    name: str
    component: str
    type: str
    tracked_point: str
    units: str
    reference_frame: str


def write(recording: Recording, folder: Path, person: str) -> Report:
    """Adds the recording to the data set in `folder` as its person's next run.

    Args:
        recording: what is written.
        folder: of the data set; made if it isn't there.
        person: anonymous id, letters and digits.
    Raises:
        RecordingError: no device's states are recorded, the id is no BIDS label, or it can't be written.
    """
    layout = recording.layout
    if not re.fullmatch("[0-9A-Za-z]+", person):
        raise RecordingError("--person", f"'{person}' is no BIDS label", "Give letters and digits, such as P07")
    systems = {d: [f for f in recording.states(d) if f.size] for d in layout.devices}
    systems = {d: fields for d, fields in systems.items() if _moves(fields)}
    if not systems:
        problem = "no device gives motion: positions, orientations, velocities or joint angles"
        raise RecordingError(str(recording.path), problem, "Use --parquet or --mcap")
    labels: dict[str, str] = {}
    for device in systems:
        if (other := labels.setdefault(_label(device), device)) != device:
            problem = f"'{other}' and '{device}' have the same BIDS label: one would take the other's place"
            raise RecordingError(str(recording.path), problem, "Use --parquet or --mcap, or rename one in the profile")
    task = str(layout.meta.get("name", "srl"))
    motion = folder / f"sub-{person}" / "motion"
    try:
        motion.mkdir(parents=True, exist_ok=True)
        mine = re.compile(rf"sub-{person}_task-{_label(task)}_.*run-(\d+)_")
        run = 1 + max((int(m[1]) for p in motion.iterdir() if (m := mine.match(p.name))), default=0)
    except OSError as error:
        problem = f"the folder can't be made: {error.strerror}"
        raise RecordingError(str(folder), problem, "Choose another place") from None
    files: list[Path] = []
    for device, fields in systems.items():
        stem = f"sub-{person}_task-{_label(task)}_tracksys-{_label(device)}_run-{run}"
        files += _system(recording, device, fields, motion, stem, task)
    files += _events(recording, motion / f"sub-{person}_task-{_label(task)}_run-{run}_events.tsv")
    _data_set(folder, person, [p.relative_to(folder / f"sub-{person}") for p in files], recording)
    held = {f.name for fields in systems.values() for f in fields}
    rest = [f.name for f in layout.fields.values() if f.name not in held and f.size]
    left_out = [f"{len(rest)} signals: {listed(rest)}"] if rest else []
    left_out += ["the loop's states and counts", "the profile's text and calibration files"]
    content = f"run {run} of {person}: {len(recording.rows)} samples of {', '.join(systems)}"
    return Report(files, content, left_out)


def _label(text: str) -> str:
    return re.sub("[^0-9A-Za-z]", "", text)


def _moves(fields: Sequence[Field]) -> bool:
    return any(channel.type != "MISC" for f in fields for e in elements(f) for channel in [_channel(f, e)])


def _channel(field: Field, element: Element) -> Channel:
    """A channel by the names of the element and the signal."""
    last, term = element.parts[-1] if element.parts else "", field.name.rpartition(".")[2]
    kind, component = "MISC", "n/a"
    if element.unit == "m" and last in POINT:
        kind, component = "POS", last
    elif element.unit == "1" and last in QUATERNION:
        kind, component = "ORNT", COMPONENTS[last]
    elif element.unit in ("m/s", "rad/s") and last[:1] in RATES and last[1:] in POINT:
        kind, component = RATES[last[0]], last[1:]
    elif element.unit == "rad" and last == "yaw":
        kind, component = "ORNT", "z"
    elif element.unit == "rad" and term == "position":
        kind = "JNTANG"
    owner = field.name.partition(".")[0]
    point = element.parts[0] if len(element.parts) > 1 or kind == "JNTANG" else owner
    frame = NONE if component == "n/a" else field.frame or DEVICE
    return Channel(element.name, component, kind, point, element.unit, frame)


def _system(
    recording: Recording, device: str, fields: Sequence[Field], folder: Path, stem: str, task: str
) -> list[Path]:
    layout = recording.layout
    channels = [
        Channel("latency", "n/a", "LATENCY", "n/a", "s", NONE),
        Channel("age", "n/a", "MISC", device, "s", NONE),
    ]
    channels += [_channel(f, e) for f in fields for e in elements(f)]
    now, stamp = recording.int("now"), recording.int(f"{device}.stamp")
    latency = (now - now[0]) / 1e9
    age = np.where(stamp < 0, np.nan, (now - stamp) / 1e9)
    values = [layout.value(recording.rows, f.name).reshape(len(now), -1) for f in fields]
    _table(folder / f"{stem}_motion.tsv", np.column_stack([latency, age, *values]))
    lines = ["\t".join(COLUMNS), *("\t".join(getattr(c, name) for name in COLUMNS) for c in channels)]
    _text(folder / f"{stem}_channels.tsv", "\n".join(lines) + "\n")
    about = layout.meta.get("frames", {})
    levels = {
        name: {"RotationRule": "right-hand", "Description": _described(name, about.get(name))}
        for name in sorted({c.reference_frame for c in channels} - {NONE})
    }
    sidecar = {
        "reference_frame": {"Description": "Frame of the channel's coordinates; lengths in m.", "Levels": levels},
    }
    _text(folder / f"{stem}_channels.json", json.dumps(sidecar, indent=2) + "\n")
    _text(
        folder / f"{stem}_motion.json",
        json.dumps(_sidecar(recording, device, channels, latency, task), indent=2) + "\n",
    )
    return [folder / f"{stem}_motion.tsv"]


def _described(name: str, entry: dict[str, Any] | None) -> str:
    if name == DEVICE:
        return "As the device gives them; the recording names no frame."
    if entry is None:
        return f"The frame '{name}' of the profile."
    place = {key: value for key, value in entry.items() if value is not None and key != "speed"}
    return f"The frame '{name}' of the profile (m, quaternion w x y z): {json.dumps(place)}"


def _sidecar(
    recording: Recording, device: str, channels: Sequence[Channel], latency: Array, task: str
) -> dict[str, Any]:
    meta = recording.layout.meta
    up, down = meta["rate"]
    counts = {f"{kind}ChannelCount": sum(c.type == kind for c in channels) for kind in TYPES}
    points = {c.tracked_point for c in channels if c.type not in ("MISC", "LATENCY")}
    about = (meta.get("devices") or {}).get(device) or {}
    simulated = device in recording.layout.simulated
    effective = (len(latency) - 1) / latency[-1] if latency[-1] > 0 else up / down
    return {
        "TaskName": task,
        "TaskDescription": f"A run of the profile '{task}'" + (", with this device simulated" if simulated else ""),
        "SamplingFrequency": up / down,
        "SamplingFrequencyEffective": float(effective),
        "RecordingDuration": float(latency[-1]),
        "TrackingSystemName": f"{device} (driver {about.get('driver', 'n/a')})",
        "SoftwareVersions": f"srl-runtime {__version__}; recorded with {json.dumps(meta.get('versions', {}))}",
        "MotionChannelCount": len(channels),
        "TrackedPointsCount": len(points),
        "MissingValues": "n/a",
        "SubjectArtefactDescription": "n/a",
        **dict.fromkeys(UNKNOWN, NONE),
        **counts,
    }


def _table(path: Path, values: Array) -> None:
    """Writes numbers without a header, each with as many digits as its bits need; "n/a" for NaN."""
    with whole_file(path) as part, open(part, "w", newline="\n") as file:
        for row in values.tolist():
            file.write("\t".join("n/a" if isnan(v) else repr(v) for v in row) + "\n")


def _events(recording: Recording, path: Path) -> list[Path]:
    """Writes the events with their times from the first row, s."""
    if not recording.events:
        return []
    cycles, now = recording.int("cycle"), recording.int("now")
    lines = ["onset\tduration\ttrial_type\tcycle\tdescription"]
    for event in recording.events:
        at = max(int(np.searchsorted(cycles, event.cycle, "right")) - 1, 0)
        text = re.sub(r"\s+", " ", event.text)
        lines.append(f"{float(now[at] - now[0]) / 1e9!r}\tn/a\t{event.level.name.lower()}\t{event.cycle}\t{text}")
    _text(path, "\n".join(lines) + "\n")
    sidecar = {
        "cycle": {"Description": "The loop's cycle."},
        "description": {"Description": "What the runtime said."},
        "StimulusPresentation": {"SoftwareName": "srl-runtime", "SoftwareVersion": __version__},
    }
    _text(path.with_suffix(".json"), json.dumps(sidecar, indent=2) + "\n")
    return []


def _data_set(folder: Path, person: str, files: Sequence[Path], recording: Recording) -> None:
    """Writes what belongs to the whole data set, where it isn't there, and adds person and files to the lists."""
    name = folder.resolve().name
    first = {
        "dataset_description.json": json.dumps(
            {
                "Name": name, "BIDSVersion": VERSION, "DatasetType": "raw",
                "GeneratedBy": [{"Name": "srl-runtime", "Version": __version__}],
            }, indent=2,
        ) + "\n",
        "README.md": f"# {name}\n\n{ABOUT}",
    }  # fmt: skip
    for file, text in first.items():
        if not (folder / file).exists():
            _text(folder / file, text)
    _add_line(folder / "participants.tsv", "participant_id", f"sub-{person}")
    wall = int(recording.layout.meta.get("wall", 0)) + int(recording.int("now")[0])
    started = datetime.fromtimestamp(wall // 1_000_000_000, UTC) + timedelta(microseconds=wall % 1_000_000_000 // 1000)
    text = started.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    for path in files:
        _add_line(folder / f"sub-{person}" / f"sub-{person}_scans.tsv", "filename\tacq_time", f"{path}\t{text}")


def _add_line(path: Path, head: str, line: str) -> None:
    old = (path.read_text() if path.exists() else "") or f"{head}\n"
    names = old.splitlines()[0].split("\t")
    if line.split("\t", maxsplit=1)[0] not in [other.split("\t")[0] for other in old.splitlines()]:
        more = ["n/a"] * (len(names) - len(line.split("\t")))  # a person's list may have further columns
        _text(path, old.rstrip("\n") + "\n" + "\t".join([line, *more]) + "\n")


def _text(path: Path, text: str) -> None:
    with whole_file(path) as part:
        part.write_text(text)
