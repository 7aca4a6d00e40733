"""The house stands: no import runs up a floor, and none goes round in a circle (docs/architecture.md, Rooms).

Imports are read from the source, wherever they stand in a file: one inside a function is an arrow, too.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from helpers import ROOT

FOLDERS = ("runtime", "drivers", "sim", "profiles", "studies", "bench", "srl")
# What a room may import besides itself. `runtime` alone is the package's own __init__ (version, BLAS threads).
GROUND = {"runtime", "runtime.contracts"}
LOOP = GROUND | {f"runtime.{r}" for r in ("messages", "control", "guard", "ipc", "recording", "profile", "loop")}
DESCRIPTIONS = {  # data, not laws
    *("runtime.control.robots", "runtime.control.hand.human_hand", "runtime.control.ikns.body"),
    *("runtime.control.models", "runtime.control.skeleton.arms", "runtime.control.skeleton.bvh"),
    *("runtime.control.model", "runtime.control.robot_model"),
}
ROOMS: dict[str, set[str]] = {
    "runtime": set(),
    "runtime.contracts": {"runtime"},
    "runtime.messages": GROUND,
    "runtime.control": GROUND,
    "runtime.guard": GROUND,
    "runtime.ipc": GROUND,
    "runtime.recording": GROUND | {"runtime.ipc"},
    "runtime.profile": LOOP - {"runtime.loop", "runtime.profile"},
    "runtime.loop": LOOP - {"runtime.loop"},
    "runtime.bus": LOOP,
    "runtime.recorder": LOOP,
    "runtime.panel": LOOP,
    "runtime.service": LOOP,
    "runtime.calibration": LOOP | {"runtime.recorder", "runtime.service", "runtime.jog"},
    "runtime.jog": LOOP | {"runtime.service"},
    "runtime.operator": LOOP | {"runtime.bus", "runtime.panel"},
    "runtime.viewing": LOOP | {"runtime.panel", "runtime.recorder"},
    "runtime.export": LOOP,
    "runtime.testing": LOOP,
    "runtime.cli": LOOP
    | {"runtime.bus", "runtime.recorder", "runtime.panel", "runtime.service", "runtime.calibration"}
    | {"runtime.export", "runtime.jog", "runtime.operator"},
    "drivers": GROUND | {"runtime.messages", "runtime.recording"},
    "sim.world": GROUND | {"runtime.messages"} | DESCRIPTIONS,
    "sim.wearer": GROUND | {"sim.world", "drivers"} | DESCRIPTIONS,
    "sim.parts": GROUND | {"sim.world", "sim.wearer", "drivers", "runtime.messages"} | DESCRIPTIONS,
    "sim.devices": GROUND | {"sim.world", "sim.wearer", "sim.parts", "drivers", "runtime.messages"} | DESCRIPTIONS,
    "srl": LOOP
    | {"runtime.bus", "runtime.testing", "drivers", "sim.world", "sim.parts.hand", "sim.devices.shared"}
    | DESCRIPTIONS,
}


def modules() -> dict[str, Path]:
    """Every module of ours by its dotted name."""
    found = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
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


def room(module: str) -> str:
    """The longest entry of ROOMS that the module lies in; its top folder where there is none."""
    within = [r for r in ROOMS if module == r or module.startswith(f"{r}.")]
    found = max(within, key=len, default=module.partition(".")[0])
    return module.partition(".")[0] if found == "runtime" and module not in ("runtime", "runtime.__main__") else found


def arrows() -> Iterator[tuple[str, str]]:
    for module in MODULES:
        for target in imports(module):
            yield module, target


def allowed(module: str, target: str) -> bool:
    """Whether the room of `module` may know `target`."""
    own = room(module)
    if own not in ROOMS or module == "runtime.__main__":  # studies, bench: they stand on everything
        return target.partition(".")[0] not in ("bench", "srl") or own == target.partition(".")[0]
    if target == own or target.startswith(f"{own}."):
        return True
    return any(target == r or (r != "runtime" and target.startswith(f"{r}.")) for r in ROOMS[own])


def test_every_module_lies_in_a_room() -> None:
    known = set(ROOMS) | {"drivers", "sim", "studies", "bench", "profiles", "runtime.__main__"}
    lost = [m for m in MODULES if m not in known and not any(m.startswith(f"{r}.") for r in known - {"runtime", "sim"})]
    assert lost == []


def test_no_import_runs_up_a_floor() -> None:
    wrong = [f"{module} imports {target}" for module, target in arrows() if not allowed(module, target)]
    assert wrong == [], "\n".join(["", *sorted(wrong)])


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


@pytest.mark.parametrize("room", ["runtime.loop", "runtime.bus", "runtime.recorder", "runtime.service", "runtime.cli"])
def test_the_service_names_no_device_law_or_simulator(room: str) -> None:
    """They come through the registry."""
    for module in MODULES:
        if module.startswith(room):
            named = {
                t for t in imports(module) if t.split(".")[0] in ("drivers", "sim") or t.startswith("runtime.control")
            }
            assert not named, f"{module} imports {sorted(named)}"
            assert "import mujoco" not in MODULES[module].read_text()
