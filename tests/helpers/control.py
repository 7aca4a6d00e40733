"""Runs controllers without the loop: binds arrays, and hands the command back as applied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from srl.control.hand.extra_finger import ExtraFinger, FingerKinematics
from srl.control.hand.hand_kinematics import HandKinematics, HandKinematicsConfig
from srl.control.hand.object_mapping import ObjectMapping, ObjectMappingConfig
from srl.control.shared.kinematics import Chain
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import JOINTS, hand_geometry

C = TypeVar("C", bound=Controller)

# At the wrist, opposite the palm: at zero the sixth finger points straight out of the palm.
WORN = (0.0, -0.020, -0.030, 0.5, -0.5, 0.5, 0.5)
HOME = np.deg2rad([0.0, 40.0, 30.0, 30.0])
RELAXED = np.deg2rad([-20.0, 20, 10, 10] + [0.0, 15, 15, 10] * 4)
FIST = np.deg2rad([-40.0, 60, 30, 40] + [0.0, 70, 80, 50] * 4)


def bound(controller: C, **transforms: Sequence[float]) -> C:
    """The controller with arrays of its own; outputs named "q" count as wired to a device.

    `transforms`: poses by name, x y z (m), w x y z; the others are the identity.
    """
    arrays = [{s.name: np.zeros(s.shape) for s in group} for group in (controller.inputs, controller.outputs)]
    applied = {"q": arrays[1]["q"].copy()} if "q" in arrays[1] else {}
    parameters = {p.name: np.array(p.default) for p in controller.parameters}
    assert transforms.keys() <= {t.name for t in controller.transforms}
    poses = {t.name: np.array(transforms.get(t.name, IDENTITY), float) for t in controller.transforms}
    controller.bind(*arrays, applied, parameters, poses)
    return controller


def mapping(
    tips: Array, home: Array = HOME, places: Mapping[str, Sequence[float]] | None = None, **options: object
) -> ObjectMapping:
    """A bound and reset object mapping whose fingers stand at `home`, worn as the sixth finger or at `places`."""
    law = ObjectMapping("mapping", ObjectMappingConfig(**options))
    controller = bound(law, **({t.name: WORN for t in law.transforms} | dict(places or {})))
    controller.input["tips"][:] = tips
    controller.applied["q"][:] = home
    controller.reset()
    return controller


def step(controller: ObjectMapping, tips: Array, dt: float = 0.01) -> Array:
    """One cycle in which the guard lets everything through; the command."""
    controller.input["tips"][:] = tips
    controller.update(dt)
    controller.applied["q"][:] = controller.output["q"]
    return controller.output["q"].copy()


def finger_tip(q: Array, finger: ExtraFinger | None = None) -> Array:
    """(3,) m, an extra finger's tip at joint angles q (n,) rad."""
    model = (finger or ExtraFinger()).model
    return np.array(FingerKinematics(model, homogeneous(WORN), 0.01).chain.forward(q.tolist()))


def hand_chains(**length: float) -> list[Chain]:
    """The fingers of the model hand, one by one."""
    return [Chain(base, rows) for base, rows in zip(*hand_geometry(**length), strict=True)]


def hand_tips(q: Array) -> Array:
    """(5, 3) m, fingertips of the model hand at joint angles q (20,) rad."""
    return np.array([c.forward(a) for c, a in zip(hand_chains(), q.reshape(5, 4).tolist(), strict=True)])


def glove(sensors: int = 22, **options: object) -> HandKinematics:
    return bound(HandKinematics("hand", HandKinematicsConfig(sensors=sensors, **options)))


def adroit_hand(position: Array) -> Array:
    """(20,) rad of the model from the 24 Adroit hand angles of the door recordings, joint by joint.

    The two thumbs are built differently: its opposition becomes abduction, the flexions follow in turn.
    """
    q = np.zeros(len(JOINTS))
    q[0:4] = -position[19], position[20], -position[22], -position[23]
    q[4:8], q[8:12], q[12:16], q[16:20] = position[2:6], position[6:10], position[10:14], position[15:19]
    return q
