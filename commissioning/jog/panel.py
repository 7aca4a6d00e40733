"""A row of the run as what the screen shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan
from typing import Any, Final

import numpy as np

from srl.commissioning.jog.profile_subset import ProfileSubset
from srl.commissioning.jog.screen import MOVES, Joint, View
from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.contracts.terms import POSITION_OF
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.layout import Layout

_LOADS: Final = ("effort", "torque", "force", "load", "current")


class Panel:
    """Makes views of rows."""

    def __init__(self, subset: ProfileSubset, layout: Layout, instance: str) -> None:
        """`layout` is the run's own, with the limits that its devices gave."""
        self._subset, self._layout = subset, layout
        self._actuator = subset.actuator
        device = subset.graph.devices[subset.actuator.device].name
        self._started = False  # before that nothing is commanded
        self._title = f"srl jog {instance}: {device}" + " (simulated)" * (device in subset.graph.simulated)
        self._names = tuple(subset.speed)
        feedback = subset.actuator.command.feedback
        self._feedback = f"{device}.{feedback}" if feedback is not None else None
        fields = layout.fields
        self._load = next((name for short in _LOADS if (name := f"{device}.{short}") in fields), None)
        limits = layout.meta.get("limits", {}).get(subset.actuator.name, {})
        self._lower, self._upper = (np.ravel(limits.get(key, [])) for key in ("lower", "upper"))

    def view(self, row: Any, chosen: int, messages: Sequence[str]) -> View:
        """The view of a row (width,)."""
        state, cause = State(int(row[CYCLE.state])), Cause(int(row[CYCLE.cause]))
        self._started = self._started or state in (State.HOMING, State.ACTIVE, State.STOPPING)
        commanded = self._of(row, f"{self._actuator.name}.applied" if self._started else None)
        actual, load = self._of(row, self._feedback), self._of(row, self._load)
        joints = [
            Joint(
                name, self._subset.units[name], actual[name], commanded[name], _at(self._lower, i), _at(self._upper, i),
                self._subset.speed[name], load[name],
            )
            for i, name in enumerate(self._names)
        ]  # fmt: skip
        fault_source = self._layout.fault_source(cause, int(row[CYCLE.fault_source]))
        text = state.name.lower()
        if cause:
            text += f" ({cause.name.lower().replace('_', ' ')} {fault_source})".replace(" )", ")")
        if latched := latches.names(int(row[CYCLE.latches])):
            text += f", latched: {', '.join(latched)}"
        keys = {State.READY: "s start   q end", State.STOPPED: "r reset   q end"}.get(state, MOVES)
        load_text = ""
        if self._load is not None:
            load_text = f"{self._load.partition('.')[2]} {self._layout.fields[self._load].unit}"
        velocities = self._actuator.command.kind is Kind.VELOCITY
        return View(self._title, velocities, joints, chosen, load_text, text, state is State.ACTIVE, keys, messages)

    def _of(self, row: Any, name: str | None) -> Mapping[str, float]:
        """A signal's elements by the joints' names; NaN for what isn't there."""
        if name is None:
            return dict.fromkeys(self._names, nan)
        field = self._layout.fields[name]
        values: Array = self._layout.value(row, name).ravel()
        if values.size == 1 and len(self._names) == 1:
            return {self._names[0]: float(values[0])}
        found = dict(zip(field.labels, values.tolist(), strict=False))
        return {joint: found.get(joint, found.get(POSITION_OF.get(joint, ""), nan)) for joint in self._names}


def _at(values: Array, i: int) -> float:
    return float(values[i]) if i < values.size else nan
