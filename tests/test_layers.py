"""No import runs up a layer, and there are no cycles (docs/architecture.md, Layers).

Imports are read from the source, wherever they stand in a file: one inside a function counts, too.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from helpers import ROOT

FOLDERS = ("runtime", "control", "commissioning", "drivers", "sim", "profiles", "studies", "srl")
# What a package may import besides itself.
BASE = {"srl.runtime.contracts"}
DATA = BASE | {"srl.runtime.models", "srl.runtime.messages"}
LOOP = DATA | {f"srl.runtime.{name}" for name in ("guard", "ipc", "recording", "profile", "loop")}
SERVICE = LOOP | {f"srl.runtime.{name}" for name in ("bus", "recorder", "pictures", "overview", "web", "service")}
SIM = DATA | {"srl.drivers"}
LAYERS: dict[str, set[str]] = {
    "srl.runtime.contracts": set(),
    "srl.runtime.messages": BASE,
    "srl.runtime.models": BASE,
    "srl.runtime.guard": BASE,
    "srl.runtime.ipc": BASE,
    "srl.runtime.recording": BASE | {"srl.runtime.ipc"},
    "srl.runtime.profile": LOOP - {"srl.runtime.loop"},
    "srl.runtime.loop": LOOP,
    "srl.runtime.bus": LOOP,
    "srl.runtime.ros2": LOOP | {"srl.runtime.bus"},
    "srl.runtime.overview": LOOP,
    "srl.runtime.pictures": LOOP | {"srl.runtime.overview"},
    "srl.runtime.recorder": LOOP | {"srl.runtime.pictures"},
    "srl.runtime.service": LOOP,
    "srl.runtime.web": LOOP | {f"srl.runtime.{name}" for name in ("bus", "pictures", "recorder", "ros2")},
    "srl.runtime.export": LOOP | {"srl.runtime.pictures", "srl.runtime.ros2"},
    "srl.runtime.testing": LOOP,
    "srl.runtime.cli": SERVICE | {"srl.runtime.export", "srl.runtime.ros2"},
    "srl.drivers": DATA | {"srl.runtime.recording"},
    "srl.control": DATA | {"srl.runtime.recording"},
    "srl.commissioning.calibration": SERVICE | {"srl.control", "srl.drivers", "srl.commissioning.jog"},
    "srl.commissioning.jog": SERVICE | {"srl.control"},
    "srl.commissioning.new": SERVICE | {"srl.control", "srl.drivers"},
    "srl.commissioning.cli": SERVICE
    | {"srl.control", "srl.drivers", "srl.runtime.cli", "srl.runtime.export"}
    | {"srl.commissioning.calibration", "srl.commissioning.jog", "srl.commissioning.new"},
    "srl.sim.world": DATA,
    "srl.sim.wearer": SIM | {"srl.sim.world"},
    "srl.sim.parts": SIM | {"srl.sim.world", "srl.sim.wearer"},
    "srl.sim.devices": SIM | {"srl.sim.world", "srl.sim.wearer", "srl.sim.parts"},
    "srl.profiles": set(),
}
"""Studies stand on everything, and `srl` itself passes on what is public of all of it."""


def modules() -> dict[str, Path]:
    """Every module of ours by its dotted name."""
    found = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join(parts if folder == "srl" else ("srl", *parts))] = path
    return found


MODULES = modules()


@cache
def imports(module: str) -> frozenset[str]:
    """The modules of ours that a module imports by name (packages stand for their __init__)."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            base = node.module or ""
            found |= {name if (name := f"{base}.{a.name}") in MODULES else base for a in node.names}
    return frozenset(name for name in found if name in MODULES and name != module)


def layer(module: str) -> str:
    """The longest entry of LAYERS that the module lies in; "" for none."""
    return max((r for r in LAYERS if module == r or module.startswith(f"{r}.")), key=len, default="")


def arrows() -> Iterator[tuple[str, str]]:
    for module in MODULES:
        for target in imports(module):
            yield module, target


def allowed(module: str, target: str) -> bool:
    """Whether the layer of `module` may import `target`."""
    own = layer(module)
    if not own or target in ("srl", "srl.runtime"):  # the version, the BLAS threads
        return True
    return any(target == r or target.startswith(f"{r}.") for r in {*LAYERS[own], own})


def test_every_module_lies_in_a_layer() -> None:
    free = ("srl.studies", "srl.runtime", "srl.control", "srl.commissioning", "srl.sim", "srl")
    lost = [
        m
        for m in MODULES
        if not layer(m) and m not in free and not m.startswith("srl.studies.") and MODULES[m].parent.name != "srl"
    ]
    assert lost == []


def test_no_import_runs_up_a_layer() -> None:
    wrong = [f"{module} imports {target}" for module, target in arrows() if not allowed(module, target)]
    assert wrong == [], "\n".join(["", *sorted(wrong)])


def test_the_service_imports_nothing_that_stands_on_it() -> None:
    above = ("srl.control", "srl.commissioning", "srl.drivers", "srl.sim", "srl.studies")
    wrong = [f"{m} imports {t}" for m, t in arrows() if m.startswith("srl.runtime.") and t.startswith(above)]
    assert wrong == []


def test_no_circles() -> None:
    """Tarjan's strongly connected components, by module: one of several modules is a circle."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circles: list[list[str]] = []

    def visit(module: str) -> None:
        index[module] = low[module] = len(index)
        stack.append(module)
        for target in imports(module):
            if target not in index:
                visit(target)
                low[module] = min(low[module], low[target])
            elif target in stack:
                low[module] = min(low[module], index[target])
        if low[module] == index[module]:
            circle = []
            while True:
                circle.append(stack.pop())
                if circle[-1] == module:
                    break
            if len(circle) > 1:
                circles.append(sorted(circle))

    for module in MODULES:
        if module not in index:
            visit(module)
    assert circles == []


@pytest.mark.parametrize("name", ["loop", "bus", "recorder", "service", "cli"])
def test_the_service_doesn_t_know_the_simulator(name: str) -> None:
    for module, path in MODULES.items():
        if module.startswith(f"srl.runtime.{name}"):
            assert "import mujoco" not in path.read_text()
