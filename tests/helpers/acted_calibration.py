"""What stands in for a calibrated thing: rows without physics, their recording, and the command that takes them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from srl.commissioning.calibration import method as methods
from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.method import Method
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.sources import RowFile, Rows, RowSource
from srl.runtime.cli import main
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.profile import profile


class Acted(RowSource):
    """Rows that a subclass fills.

    Attributes:
        method: how it is calibrated.
        rows: all so far.
        step: the newest.
        period: ns, of the rows.
        look: rows that come together.
    """

    channel_map: Any
    period = 20_000_000
    look = 5

    def __init__(
        self, kind: type[Method[Any, Any]], request: CalibrationRequest, text: str, simulated: str,
        settings: Sequence[str] = (),
    ) -> None:  # fmt: skip
        """`text`: the profile. `simulated`: its device that is simulated; "": all are."""
        checked, source = profile.parse(request.profile, text, settings)
        self.method = kind(request, checked, source, Path("p07.json"), lambda _: None)
        self.graph = build(*self.method.subset(request.person or ""), sim=False)
        layout = self.graph.layout
        layout.meta["wall"] = 1_700_000_000_000_000_000
        layout.meta["simulated"] = [simulated] if simulated else list(layout.devices)
        self.channel_map = self.method.channel_map(layout, request.profile)
        self.rows, self.closed, self._t = list[Rows](), False, 0
        self.step: Any = None

    def take(self) -> Rows:
        made = np.array([self._next() for _ in range(self.look)])
        self.rows.append(made)
        return made

    def begin(self, procedure: Any) -> None:
        self.graph.row.views[self.channel_map.parameter][()] = procedure.step.mark
        self.step = procedure.step
        self.instruct(procedure.step, procedure.instruction())

    def close(self) -> None:
        self.closed = True

    @property
    def time(self) -> float:
        """s."""
        return self._t * self.period * 1e-9

    @abstractmethod
    def instruct(self, step: Any, instruction: Any) -> None:
        """A step begins, with its instruction."""

    @abstractmethod
    def fill(self, row: Any) -> None:
        """Fills the graph's row: what is measured, and the links."""

    def _next(self) -> Any:
        self._t += 1
        row = self.graph.row
        self.fill(row)
        row.ints[CYCLE.cycle], row.ints[CYCLE.now], row.ints[CYCLE.state] = self._t, self._t * self.period, State.ACTIVE
        return row.words.copy()


def feed(actor: Acted, procedure: Procedure, seconds: float) -> None:
    """Goes on for so long, or until it is done."""
    end = actor._t + seconds * 1e9 / actor.period
    while actor._t < end and not procedure.done:
        if procedure.step is not actor.step:
            actor.begin(procedure)
        procedure.feed(actor.channel_map.samples(actor.take()))


def recorded(actor: Acted, path: Path) -> None:
    """Writes its rows so far as a recording."""
    file = RowFile(actor.graph.layout, path)
    for rows in actor.rows:
        file.add(rows)
    file.close()


def calibrate(
    monkeypatch: pytest.MonkeyPatch, report: ModuleType, profile_name: str, kind: str, actor: Callable[[], RowSource],
    typed: Sequence[str] = (), personal: bool = True,
) -> Callable[..., int]:  # fmt: skip
    """`srl calibrate` without physics; the picture is drawn only if asked for, as it takes long.

    `typed`: options that are always given, but with `--recording`.
    """
    drawn = report.draw

    def run(*arguments: str, actor: RowSource | None = None, picture: bool = False, person: bool = True) -> int:
        monkeypatch.setattr(report, "draw", drawn if picture else lambda _, png: png.touch())
        monkeypatch.setattr(methods, "Simulated", lambda *_: actor or made())
        own = ("--person", "P07") if personal and person else ()
        always = typed if "--recording" not in arguments else ()
        return main(["calibrate", profile_name, kind, *own, *always, *arguments])

    made = actor
    return run
