"""Cells with a simulated person, fixtures, and a trolley that behaves as an ideal admittance-controlled robot."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from srl.sim.parts.person.person import PersonPart
from srl.sim.parts.person.plans import GoTo, Hold, Press
from srl.sim.parts.things.box import BoxPart
from srl.sim.world.cell import Cell, CellConfig
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

MS = 1_000_000
HEAVY = {"mass": 1e4, "inertia": 1e3, "damping": 0.0, "turn_damping": 0.0}  # stays where a test puts it


class TrolleyConfig(PartConfig):
    mass: float = 6.0
    damping: float = 40.0
    inertia: float = 1.0
    turn_damping: float = 1.8


class Trolley(Part):
    """A floating body `NAME/body` without weight: M xdd + D xd = F, as eq. 1 of SUPER-MAN wants a robot to be."""

    Config = TrolleyConfig
    summary = "for tests"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config: Any = self.config
        body = mjcf.body(parent, f"{self.name}/body", gravcomp=1, **self.at())
        add(body, "inertial", pos=(0, 0, 0), mass=config.mass, diaginertia=(config.inertia,) * 3)
        for kind, drag in (("slide", config.damping), ("hinge", config.turn_damping)):
            for axis, along in zip("xyz", np.eye(3).tolist(), strict=True):
                add(body, "joint", name=f"{self.name}/{kind}_{axis}", type=kind, axis=along, damping=drag)

    def bind(self, model: Any, data: Any) -> None:
        first = model.joint(f"{self.name}/slide_x")
        at, dof = int(first.qposadr[0]), int(first.dofadr[0])
        self.q, self.v = data.qpos[at : at + 6], data.qvel[dof : dof + 6]


def cell(parts: dict[str, tuple[type[Part], dict[str, Any]]], seed: int = 1, **options: Any) -> Cell:
    """A cell of parts given by class, so that a test needs no entry points."""
    made = {name: (cls, cls.Config.model_validate(given)) for name, (cls, given) in parts.items()}
    return Cell(CellConfig.model_construct(parts=made, **options), seed)


def run(world: Cell, seconds: float, every: int = 10, until: Any = None) -> dict[str, Any]:
    """Truth at each `every` ms, by signal, until the time or the condition."""
    seen: dict[str, list[Any]] = {name: [] for name in world.truth_arrays} | {"time": []}
    end = world.time + round(seconds * 1e9)
    while world.time < end and not (until and until(world)):
        world.advance(world.time + every * MS)
        seen["time"].append(world.time * 1e-9)
        for name, values in world.truth_arrays.items():
            seen[name].append(values.copy())
    return {name: np.array(rows) for name, rows in seen.items()}


def quiet() -> dict[str, Any]:
    """A person without tremor, noise and drift."""
    return {"tremor": 0.0, "noise": 0.0, "drift": 0.0}


def go_to(*position: float, **options: Any) -> GoTo:
    return GoTo.model_validate({"do": "go_to", "position": position} | options)


def hold(seconds: float) -> Hold:
    return Hold(do="hold", seconds=seconds)


def press(button: str, seconds: float = 0.2) -> Press:
    return Press(do="press", button=button, seconds=seconds)


def finished(world: Cell) -> bool:
    person = world.parts["person"]
    assert isinstance(person, PersonPart)
    return person.done


def alone(plan: Any, tool: float = 3.0, seed: int = 1, **options: Any) -> Any:
    """A person without a robot, a tool of so many kg in the hand."""
    parts: Any = {"person": (PersonPart, {"at": {"position": [0, 0, 1]}, "plan": plan, **options})}
    if tool:
        box = {"at": "person/hand", "size": [0.05, 0.05, 0.05], "mass": tool, "touches": False}
        parts["tool"] = (BoxPart, box)
    return cell(parts, seed)


def guided(plan: Any, seed: int = 1, trolley: Any = None, **options: Any) -> Any:
    """A person who guides an ideal robot."""
    held = {"at": "robot/body", "plan": plan, **options}
    return cell({"robot": (Trolley, trolley or {}), "person": (PersonPart, held)}, seed)


def put(world: Any, x: float, y: float, z: float, seconds: float = 0.01) -> None:
    """Puts the trolley somewhere, and waits."""
    robot, end = world.parts["robot"], world.time + round(seconds * 1e9)
    while world.time < end:
        robot.q[:] = x, y, z, 0, 0, 0
        robot.v[:] = 0
        world.advance(min(world.time + 2 * MS, end))
