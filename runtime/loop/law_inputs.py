"""What a law was given in a recorded run, cycle by cycle: for laws that write files of other programs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.loop.replay import rebuilt
from srl.runtime.profile.graph import Graph, Law


class LawInputs:
    """The laws of a recording's profile, and what they were given."""

    def __init__(self, layout: Layout, place: str, run_code: bool = False) -> None:
        """
        Args:
            layout: the recording's.
            place: its name, for errors.
            run_code: whether code that the recording holds may be run.

        Raises:
            RecordingError: this version doesn't take the recorded profile, or its code isn't run.
        """
        layout.needs(place, "label", "profile", "overrides", "versions", "rate")
        self._layout, self._place = layout, place
        self._graph: Graph = rebuilt(layout, place, [], run_code)

    def exporting(self, form: str, name: str | None = None) -> Controller:
        """The law that writes files of a form; `name` says which, where there are several.

        Raises:
            RecordingError: there is none, there are several, or the one that is named doesn't write this form.
        """
        able = [law.controller for law in self._graph.laws if form in law.controller.exports]
        if name is not None:
            able = [controller for controller in able if controller.name == name]
        if len(able) == 1:
            return able[0]
        if able:
            names = ", ".join(controller.name for controller in able)
            raise RecordingError(self._place, f"several laws write {form}: {names}", "Name one with --law")
        what = f"no law of this recording{f' called {name!r}' if name else ''} writes {form}"
        those = [law.controller.name for law in self._graph.laws if form in law.controller.exports]
        if name is not None and those:
            raise RecordingError(self._place, what, nearest(name, those))
        raise RecordingError(self._place, what, "Record a run with a law that does, or choose another format")

    def of(self, controller: Controller, rows: NDArray[np.int64]) -> dict[str, Array]:
        """(k, *shape) by input name: what a law was given in rows (k, width)."""
        law: Law = next(law for law in self._graph.laws if law.controller is controller)
        views = self._graph.row.views
        names = dict.fromkeys(name for wire in law.inputs.values() for name in wire.far)
        if gone := [name for name in names if name not in self._layout.fields]:
            raise RecordingError(self._place, f"it has no signal '{gone[0]}'", "Use another recording")
        given = [(views[name], self._layout.value(rows, name)) for name in names]
        found = {name: np.empty((len(rows), *array.shape)) for name, array in controller.input.items()}
        floats = self._graph.row.floats
        for k in range(len(rows)):
            for view, values in given:
                view[...] = values[k]
            for index, array in law.reads:
                floats.take(index, 0, array, "clip")
            for name, array in controller.input.items():
                found[name][k] = array
        return found
