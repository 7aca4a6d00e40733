"""The cell's part `passive-hand`: a hand that doesn't grasp, against which a worn finger presses things."""

from __future__ import annotations

from math import cos, sin
from typing import Annotated, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.rotation import composed, from_matrix
from srl.runtime.models.human_hand import FINGERS, JOINTS
from srl.runtime.models.models import HandOption, named
from srl.sim.parts.hand.hand import PALM, RADII
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

# Open and slightly bent, the thumb beside the palm: ours. A severely paretic hand neither closes nor opens by itself.
_OPEN: Final = (0.5, 0.0, 0.0, 0.0) + 4 * (0.0, 0.26, 0.26, 0.17)
_DENSITY: Final = 1100.0  # kg/m^3, as the moving hand's

PALM_FACE: Final = PALM["size"][2] - PALM["pos"][2]
"""m, from the wrist's centre to the palm's face, of the unscaled hand."""


class PassiveHandConfig(PartConfig):
    """Options of the hand. It stands with its wrist: x to the little finger (of a right hand), y distal, z dorsal."""

    model: HandOption = named("hand")
    posture: Annotated[tuple[Finite, ...], PerElement(JOINTS)] = Field(
        default=_OPEN, description="rad, by joint; ours: open, slightly bent"
    )
    friction: float = Field(
        default=0.62,
        gt=0,
        description="of its skin against everything: the mean of palms, Zhang and Mak (1999); one sd is 0.22",
    )
    softness: float = Field(
        default=0.01, gt=0, description="s, time constant of its contacts; ours. At least 2 time steps"
    )


class PassiveHandPart(Part):
    """A rigid hand in a fixed posture, with the body `<name>/base`: palm and phalanges of the part `human-hand`.

    It goes with what it is mounted on. Contacts take its own friction, which stands for skin.
    """

    Config: ClassVar[type[PartConfig]] = PassiveHandConfig
    summary = "a rigid, open hand that doesn't grasp, for a finger worn beside it"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = cast(PassiveHandConfig, self.config), self.name
        base = mjcf.body(parent, f"{name}/base", **self.at())
        scale = config.model.scale
        skin = {
            "density": _DENSITY,
            "priority": 2,  # before an object's own
            "condim": 4,
            "friction": (config.friction, 0.005, 0.0001),
            "solref": (config.softness, 1.0),
            "rgba": "0.86 0.69 0.58 1",
            **CONTACT["hand"],
        }
        palm = {key: tuple(scale * v for v in value) for key, value in PALM.items()}
        add(base, "geom", name=f"{name}/palm", type="box", **palm, **skin)
        angles, joints = iter(config.posture), iter(JOINTS)
        for finger, origin, rows in zip(FINGERS, *config.model.geometry(), strict=True):
            radii = iter(RADII["thumb" if finger == "thumb" else "finger"])
            pose = composed(IDENTITY, (*origin[:3, 3].tolist(), *from_matrix(origin[:3, :3])))
            for alpha, length in rows.tolist():
                half = next(angles) / 2
                pose = composed(pose, (0.0, 0.0, 0.0, cos(half), 0.0, 0.0, sin(half)))
                end = composed(pose, (length, 0.0, 0.0, cos(alpha / 2), sin(alpha / 2), 0.0, 0.0))
                joint = next(joints)
                if length > 0.0:
                    ends = np.array([pose[:3], end[:3]]).ravel()
                    size = scale * next(radii)
                    add(base, "geom", name=f"{name}/{joint}", type="capsule", fromto=ends, size=size, **skin)
                pose = end
