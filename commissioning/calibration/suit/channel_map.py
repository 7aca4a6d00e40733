"""What a calibration from a suit reads in a run's rows: each joint's rotation and translation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.run_channels import RunChannels, marks_law, words
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.profile import Profile


class SuitMarks(Protocol):
    """What is used of the marks' law's options: who, and the signals of each joint, in order."""

    @property
    def person(self) -> str: ...
    @property
    def rotation(self) -> Mapping[str, str]: ...
    @property
    def translation(self) -> Mapping[str, str]: ...


Marks = TypeVar("Marks", bound=SuitMarks)


@dataclass(frozen=True)
class SuitChannelMap(RunChannels, Generic[Marks]):
    """Attributes: the marks' `law`, its `options`; `rotation` (4 n,), `translation` (3 n,) of its joints in order."""

    law: str
    options: Marks
    rotation: NDArray[np.intp]
    translation: NDArray[np.intp]

    @classmethod
    def find(
        cls, layout: Layout, place: str, law: str, options: Callable[[dict[str, Any], Profile], Marks], unknown: str,
        what: str,
    ) -> Self:  # fmt: skip
        """Finds them by the marks' law in the layout's profile.

        Args:
            layout: of the rows.
            place: the recording, for errors.
            law: the marks' law.
            options: makes its options from its entry's, in this profile.
            unknown: what isn't known without marks, for the error.
            what: what `srl calibrate PROFILE` calibrates, for the error.
        Raises:
            RecordingError: no such law, or no such signals.
        """
        checked, entry = marks_law(layout, place, law)
        if entry is None:
            problem = f"it has no marks, so {unknown} isn't known"
            raise RecordingError(place, problem, f"Use a recording of `srl calibrate PROFILE {what}`")
        found = options(entry.options, checked)
        return cls(
            layout, layout.fields[f"{entry.name or law}.mark"].offset, law, found,
            words(layout, list(found.rotation.values()), place),
            words(layout, list(found.translation.values()), place),
        )  # fmt: skip

    @property
    def person(self) -> str:
        return self.options.person

    @property
    def parameter(self) -> str:
        return f"{self.law}.mark"

    def poses(self, floats: Array) -> tuple[Array, Array]:
        """(k, n, 4), (k, n, 3) m: each joint's rotation and translation, from rows' float64 words."""
        n = len(self.options.rotation)
        return floats[:, self.rotation].reshape(-1, n, 4), floats[:, self.translation].reshape(-1, n, 3)
