"""Chooses what computes each law and guard: C where it can, else Python; and says which in the row's metadata."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srl.runtime.contracts.compiled import PYTHON, Backend, Compiled, NotCompiledError, available, compiled, missing
from srl.runtime.contracts.errors import WiringError
from srl.runtime.guard import CommandGuard
from srl.runtime.guard.compiled import compile_guard
from srl.runtime.profile.graph import Graph


class Backends:
    """What computes each law and guard of a graph.

    Attributes:
        laws: by law, its C version; None: Python computes it.
    """

    def __init__(self, graph: Graph, guards: Sequence[CommandGuard], backend: Backend | None = None) -> None:
        """Binds the C versions, and writes into the layout's `meta["backend"]` what computes what, and why.

        Args:
            graph: the wired system.
            guards: by actuator, bound.
            backend: the choice; None: the profile's.
        Raises:
            WiringError: C is to compute, and there is none here.
        """
        wanted = backend or graph.profile.backend
        if wanted == "c" and missing():
            remedy = "Install it where there is a C compiler, or take 'backend' out of the profile"
            raise WiringError(graph.source.place("backend"), missing(), remedy)
        self.laws: list[Compiled | None] = []
        laws, held = {}, {}
        for law in graph.laws:
            made, laws[law.controller.name] = None, "c"
            try:
                _unless_python(wanted)
                made = compiled(law.controller)
            except NotCompiledError as error:
                laws[law.controller.name] = f"{PYTHON}: {error}"
            self.laws.append(made)
        for actuator, guard in zip(graph.actuators, guards, strict=True):
            held[actuator.name] = "c"
            try:
                _unless_python(wanted)
                compile_guard(guard, actuator.asked, actuator.asked_velocity)
            except NotCompiledError as error:
                held[actuator.name] = f"{PYTHON}: {error}"
        found: dict[str, Any] = {"wanted": wanted, "computed": PYTHON if wanted == PYTHON else available()}
        graph.layout.meta["backend"] = found | {"laws": laws, "guards": held}

    def give_back(self) -> None:
        """Gives each law its state back, so that its figures are right."""
        for law in self.laws:
            if law is not None:
                law.leave()


def _unless_python(wanted: Backend) -> None:
    if wanted == PYTHON:
        raise NotCompiledError("the profile's choice")
