"""The formats by name, and one function that writes any of them."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Final

from srl.runtime.contracts.errors import RequestError
from srl.runtime.export.report import Report
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.summary import persons

ENDINGS: Final = {"parquet": ".parquet", "mcap": ".mcap", "c3d": ".c3d", "mat": ".mat", "trc": ".trc", "mot": ".mot"}
FORMATS: Final = (*ENDINGS, "bids")


def write(
    form: str, recording: Recording, target: Path, *, rate: Fraction | None = None, person: str | None = None
) -> Report:
    """Writes a recording in one of FORMATS.

    Args:
        form: the format.
        recording: what is written.
        target: the file; for `bids` the data set's folder.
        rate: frames per second, for `c3d`, `trc` and `mot`; None: the loop's rate.
        person: whose it is, for `bids`; None: as the recording says.
    Raises:
        RecordingError: the format can't hold it, or it can't be written.
        RequestError: whose recording it is isn't known, for `bids`.
        HostError: the format's package isn't installed.
    """
    if form == "parquet":
        from srl.runtime.export import parquet_file

        return parquet_file.write(recording, target)
    if form == "mcap":
        from srl.runtime.export import mcap_file

        return mcap_file.write(recording, target)
    if form == "c3d":
        from srl.runtime.export import c3d_file

        return c3d_file.write(recording, target, rate)
    if form == "mat":
        from srl.runtime.export import mat_file

        return mat_file.write(recording, target)
    if form in ("trc", "mot"):
        from srl.runtime.export import opensim_files

        make = opensim_files.write_trc if form == "trc" else opensim_files.write_mot
        return make(recording, target, rate)
    from srl.runtime.export import bids_motion

    known = persons(recording.layout)
    if person is None and len(known) != 1:
        problem = "the recording doesn't say whose it is" if not known else f"it is of {', '.join(known)}"
        raise RequestError("--bids", problem, "Add --person ID")
    return bids_motion.write(recording, target, person or known[0])
