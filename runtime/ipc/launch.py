"""The launch file: the supervisor writes it to start its loop process; the loop and people read it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import ClassVar, Final

from pydantic import ConfigDict, TypeAdapter, ValidationError

from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.validation import refusal
from srl.runtime.ipc import private_file

ANONYMOUS: Final = r"^[A-Za-z]{0,4}[0-9]{1,6}$"
"""A person's id: no name fits it."""


@dataclass
class Launch:
    """The settings of one run.

    Attributes:
        label, text, overrides: the profile as it was found.
        folder: where the paths in it begin.
        files: content of the files that it names (`srl.runtime.contracts.files.encoded`). The loop reads none again.
        sim: devices to simulate; empty for all, None for none.
        fast: True to run simulated time as fast as possible.
        cycles: number of cycles after which the run ends; None: no such end.
        automatic: True to go from READY to motion without a request.
        latches: names of the latches that stand from an earlier run: this run then starts in STOPPED.
        recorded: True if a recorder reads the rows: an unpaced simulation then waits for it.
        person: the wearer's anonymous id, for the recording; empty: not said.
        said: what was done before the loop, for its events: recordings that were deleted.
        twins: the devices that are on their twins.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    label: str
    text: str
    overrides: list[str] = field(default_factory=list)
    folder: str = ""
    files: dict[str, dict[str, str]] = field(default_factory=dict)
    sim: list[str] | None = None
    fast: bool = False
    cycles: int | None = None
    automatic: bool = True
    latches: list[str] = field(default_factory=list)
    recorded: bool = False
    person: str = ""
    said: list[str] = field(default_factory=list)
    twins: list[str] = field(default_factory=list)

    @property
    def content(self) -> bytes:
        """The launch file's content: JSON."""
        return json.dumps(asdict(self)).encode()

    def save(self, path: Path) -> None:
        """Writes the launch file. Raises OSError."""
        private_file.replace(path, self.content)

    @classmethod
    def load(cls, path: Path) -> Launch:
        """Reads what `save` wrote.

        Raises:
            RecordingError: there is no such file, or it is no text.
            HostError: it is damaged, or of another version.
        """
        text = private_file.read_text(path)
        try:
            return TypeAdapter(cls).validate_json(text)
        except ValidationError as error:
            first = refusal(error)
            problem = f"the launch file is damaged: {first.path or 'the file'}: {first.problem}"
            raise HostError(str(path), problem, "Start the run again with `srl run`: it writes a new one") from None
