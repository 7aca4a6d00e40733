"""A simulated wearer who grasps with the finger on the forearm: seated at a table, the control value still a client's.

What differs from the ideal carrier is the arm: its reach, how still it holds, how exactly it comes to a place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from runtime.contracts.rotation import Pose, Quaternion, Vector, conjugate, product, turned
from runtime.control.ikns.body import Body
from runtime.loop.lockstep import Lockstep
from sim.parts.body.instructions import Hold
from sim.parts.body.upper_body import UpperBodyPart
from sim.parts.hand.objects import ObjectPart
from sim.parts.hand.ycb import YCB
from sim.world.cell import Cell
from studies.ikns.grasp import ASIDE, Client, Task, wrist
from studies.ikns.grasp_cell import PROFILE, SERVO, wired

TABLE: Final = (0.30, -0.10, 0.72)  # m: its middle, in front of the chest's right half; 0.72 m high. Ours
START: Final = (0.30, -0.22)  # m, within the arm's reach
GOAL: Final = (0.30, 0.02)
AWAY: Final = (0.45, 0.15)
"""m, where the object waits."""
SETTLE: Final = 2.5
"""s, in which the hand goes to the side of the start."""
_HALF: Final = 0.5**0.5
# The hand's frame in the body's hand: x to the little finger, y distal, z dorsal, where the body has -x, -z and -y.
HAND: Final[Quaternion] = (0.0, 0.0, _HALF, -_HALF)
_WORLD: Final = f"""
models:
  body: {{kind: body, sides: [right]}}
sim:
  world: cell
  parts:
    table: {{part: table, size: [0.4, 0.6], at: {{position: {list(TABLE)}}}}}
    wearer: {{part: upper-body, at: {{position: [0.0, 0.0, 1.1]}}}}     # the jugular notch of somebody who sits
    hand: {{part: passive-hand, at: {{parent: wearer/right_hand, quaternion: {list(HAND)}}}}}
    # At the wrist, out of the palm's side: the place of the sixth finger, on the forearm.
    finger:
      part: robotic-finger
      at: {{parent: wearer/right_forearm, position: [0.0, 0.030, -0.2355], quaternion: [0.0, {_HALF}, {_HALF}, 0.0]}}
"""


class Instructed(Client):
    """A grasper that tells the wearer of the part `upper-body` where its right hand shall be."""

    def __init__(self, lockstep: Lockstep, part: str, c: str, closing: float = 1.0) -> None:
        """Args: part, the wearer's name; c, closing: see `Client`."""
        super().__init__(lockstep, c, closing)
        world = lockstep.graph.world
        assert isinstance(world, Cell)
        self._world, self._name, self._part = world, part, world.part(UpperBodyPart, part)

    def reach(self, wrist: Pose, seconds: float) -> None:
        """Tells it to go there; how long it takes is the wearer's affair."""
        chest = self._world.pose_of(f"{self._name}/torso")
        point, turn = hand_at(self._part.body, chest, wrist)
        self._part.wearer.instruct(Hold(point, None, turn))

    @property
    def arrived(self) -> bool:
        """Whether the hand is there, as exactly as the wearer can tell."""
        return self._part.wearer.done


def wearer_cell(
    code: str, *, seed: int = 1, servo: Mapping[str, Any] = SERVO, wearer: Mapping[str, Any] | None = None, **task: Any
) -> tuple[Lockstep, Instructed, Task]:
    """The running cell, the wearer, and what is to be done.

    Args:
        code: of the object.
        servo, wearer: options of the finger's servos and of the wearer.
        task: what differs in the task.
    """
    values = {f"sim.parts.wearer.{key}": value for key, value in (wearer or {}).items()}
    lockstep = wired(PROFILE + _WORLD, code, (*AWAY, TABLE[2]), seed, servo, {}, values)
    who, made = Instructed(lockstep, "wearer", "client.c"), Task(START, GOAL, table=TABLE[2], **task)
    # A resting hand is over the start: it goes to the side, and the experimenter puts the object there.
    who.reach(wrist(made, YCB[code], START, aside=ASIDE), made.pace)
    for _ in range(round(SETTLE / lockstep.period * 1e9)):
        lockstep.step()
        who.watch()
    world = lockstep.graph.world
    assert isinstance(world, Cell)
    thing = world.part(ObjectPart, "thing")
    thing.put((*START, TABLE[2] + YCB[code].height / 2 + 1e-4, 1.0, 0.0, 0.0, 0.0))
    return lockstep, who, made


def hand_at(body: Body, chest: Pose, wrist: Pose) -> tuple[Vector, Quaternion]:
    """The right palm's middle (m) and the hand's orientation in the chest's frame, for the passive hand's frame.

    Args:
        chest, wrist: poses in the world, x y z (m), w x y z.
    """
    back = conjugate(chest[3:])
    turn = product(back, product(wrist[3:], conjugate(HAND)))
    x, y, z = turned(back, (wrist[0] - chest[0], wrist[1] - chest[1], wrist[2] - chest[2]))
    gx, gy, gz = turned(turn, body.grip("right"))
    return (x + gx, y + gy, z + gz), turn
