"""One trial of the skeleton: the suit's frames of a motion, through parser and law, against plain matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML

from srl.control.skeleton.human import human
from srl.control.skeleton.law import Skeleton, SkeletonLawConfig
from srl.drivers.noitom.config import NoitomConfig
from srl.drivers.noitom.pose import Pose
from srl.drivers.noitom.protocol import BinaryParser, TextParser, encode_binary, encode_text
from srl.drivers.noitom.skeleton import Skeleton as Suit
from srl.runtime.contracts.rotation import Quaternion, euler_angles, exp, matrices, product
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import ArmsModel
from srl.runtime.testing.bound import bound
from srl.studies.human_srl import matrices as plain
from srl.studies.human_srl.reaching import Reaching
from srl.studies.human_srl.wearers import Wearer
from srl.studies.tasks.task import Value

_TURN: Final = 0.15  # rad, by which every joint, fingers too, is turned besides, in each frame anew
_STRETCH: Final = 0.01  # of each bone, in each frame anew: suits do so
_SLIDING: Final = 4  # which joint
_ROOM: Final = 2.0  # m, in which the person stands about, turned anyhow


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One motion of one wearer with both arms, frame by frame.

    Args:
        text: the profile's.
        parameters: `wearer`, of `Wearer` by name; `wire`, text or binary; `order`, of the rotations, such as YXZ;
            `frames`, how many, at 20 Hz as the paper's.
        seed: of the motion.

    Returns:
        nodes: how many; off: m, the largest distance of a node from where the matrices have it, by the numbers that
        were sent; vector: m, the same of the matrices that a reader of the paper makes of the 540 numbers; rounding: m,
        from where the node was before the numbers were rounded for the wire.
    """
    rng, who = np.random.default_rng([seed, 3]), Wearer(**parameters["wearer"])
    order, wire = parameters["order"], parameters["wire"]
    arms = ArmsModel.model_validate(YAML(typ="safe", pure=True).load(text)["models"]["srl-arms"])
    law = bound(_Law(SkeletonLawConfig(arms=arms, scale=who.scale)))
    config = NoitomConfig.model_validate({"port": "udp://:7012", "order": order})
    suit = Suit("axis-neuron")
    pose, parser = Pose(config, suit), (TextParser if wire == "text" else BinaryParser)(0)
    reaching = Reaching(human(who.scale), np.random.default_rng([seed, 0]), who)
    states = {"rotation": law.input["rotation"], "translation": law.input["translation"]}
    worst = np.zeros(3)
    for k in range(parameters["frames"]):
        translation, degrees = _posed(reaching, k / 20.0, order, rng)
        numbers = np.hstack([100.0 * translation, degrees]).ravel()
        data = encode_text(numbers) if wire == "text" else encode_binary(numbers, k)
        frame = parser.feed(data)
        if frame is None:
            raise ValueError(f"frame {k} wasn't read")
        pose.fill(frame, states)
        for side in law.arms:
            law.input[side][:] = rng.uniform(-1.5, 1.5, 7)
            law.input[side][_SLIDING] = rng.uniform(0, 0.1)
        law.update(0.05)
        worst = np.maximum(worst, _compared(law, suit, _sent(data, wire), numbers, order))
    return {
        "nodes": len(law.output["nodes"]),
        "frames": parser.frames,
        "off": worst[0],
        "vector": worst[1],
        "rounding": worst[2],
    }


class _Law(Skeleton):
    """The law with arrays of its own.

    Attributes:
        arms: sides.
        offsets: (9, 3) m, of the right arm's nodes.
        sites: of the body, by name.
        parents: of all nodes, by name.
    """

    def __init__(self, config: SkeletonLawConfig) -> None:
        super().__init__("skeleton", config)
        tree, figure = config.figure.tree, config.figure
        self.arms, self.offsets = figure.arms.sides, figure.arms.offsets("right")
        self.names = tree.names
        self.parents = {node.name: node.parent for node in tree.nodes}
        sites = (tree.nodes[i] for i in figure.sites)
        self.sites = {node.name: (node.parent, np.array(node.offset)) for node in sites}


def _posed(reaching: Reaching, t: float, order: Any, rng: np.random.Generator) -> tuple[Array, Array]:
    """(59, 3) m and (59, 3) degrees in the order, of the person at t s; somewhere, and every joint turned a little."""
    turns = rng.normal(0.0, _TURN, (len(reaching.names), 3)).tolist()
    rotation = np.array([_turned(q, turn) for q, turn in zip(reaching.rotation(t).tolist(), turns, strict=True)])
    rotation[0] = exp(*rng.normal(0.0, 1.5, 3).tolist())
    translation = reaching.translation * rng.normal(1.0, _STRETCH, (len(rotation), 1))
    translation[0] += rng.uniform(-_ROOM, _ROOM, 3)
    return translation, np.degrees(euler_angles(matrices(rotation), order))


def _turned(q: Quaternion, turn: list[float]) -> Quaternion:
    return product(q, exp(*turn))


def _sent(data: bytes, wire: str) -> Array:
    """The 354 numbers of a frame's bytes, read in another way than the driver's."""
    if wire == "text":
        return np.array([float(word) for word in data.decode().split()[2:-1]])
    return np.frombuffer(data[-4 * 354 :], "<f4").astype(np.float64)


def _compared(law: _Law, suit: Suit, sent: Array, true: Array, order: str) -> Array:
    """(3,) m: the law by what was sent, the vector by its reader, and the law by what wasn't rounded."""
    found = dict(zip(law.names, law.output["nodes"], strict=True))
    rows = dict(zip(law.names, law.output["vector"], strict=True))
    by_numbers = [_whole(law, suit, numbers, order) for numbers in (sent, true)]
    others = [by_numbers[0], plain.of_vector(rows, law.parents, law.sites), by_numbers[1]]
    return np.array([max(float(np.linalg.norm(found[n] - each[n][:3, 3])) for n in found) for each in others])


def _whole(law: _Law, suit: Suit, numbers: Array, order: str) -> dict[str, Array]:
    made = plain.body(suit.names, suit.parents, numbers, order, law.sites)
    spine = made["Spine"]
    for side in ("right", "left"):
        q = law.input[side].tolist() if side in law.arms else [0.0] * 7
        made |= plain.arm(spine, law.offsets, q, side)
    return made
