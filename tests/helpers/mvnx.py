"""Writes MVNX files, as far as a reader of motions looks at them. Written after files of MVN Studio 4 and MVN 2019."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from srl.drivers.noitom.skeleton import Skeleton
from srl.drivers.xsens_mvn.protocol import JOINT_ENDS, SEGMENTS
from srl.runtime.contracts.rotation import matrices
from srl.runtime.contracts.signals import Array

# The suit's joint of each of MVN's segments; the toes are the feet's own.
JOINT_OF = dict(zip(SEGMENTS[:7], ("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head"), strict=True))
for _side in ("Right", "Left"):
    JOINT_OF |= {
        f"{_side}{own}": f"{_side}{joint}"
        for own, joint in (
            ("Shoulder", "Shoulder"), ("UpperArm", "Arm"), ("ForeArm", "ForeArm"), ("Hand", "Hand"),
            ("UpperLeg", "UpLeg"), ("LowerLeg", "Leg"), ("Foot", "Foot"), ("Toe", "Foot"),
        )
    }  # fmt: skip
_TO_MVN = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the suit's axes (x left, y up, z forward)


def text(
    position: Array, orientation: Array, rate: float = 60.0, *, version: str = "4", segments: Sequence[str] = SEGMENTS,
    joints: Array | None = None, centre: Array | None = None, poses: Mapping[str, tuple[Array, Array]] | None = None,
    ms: int = 1_767_322_800_000,
) -> str:  # fmt: skip
    """A file of n frames of k segments.

    Args:
        position, orientation: (n, k, 3) m; (n, k, 4) w x y z.
        joints: (n, 22, 3) degrees. centre: (n, 3) m.
        poses: before the motion, by the frame's type.
        ms: Unix time of the first frame.
    """
    ends = [(name, SEGMENTS[a - 1], SEGMENTS[b - 1]) for name, (a, b) in JOINT_ENDS.items()]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="{version}">',
        '<mvn version="2019.0.0" build="made by a test"/>', "<comment></comment>",
        f'<subject label="P07" frameRate="{rate:g}" segmentCount="{len(segments)}" configuration="FullBody">',
        "<segments>",
        *(f'<segment label={quoteattr(name)} id="{i}"><points/></segment>' for i, name in enumerate(segments, 1)),
        "</segments>", "<joints>",
        *(f'<joint label="j{n}"><connector1>{a}/j{n}</connector1><connector2>{b}/j{n}</connector2></joint>'
          for n, a, b in ends),
        "</joints>", f'<frames segmentCount="{len(segments)}" sensorCount="17" jointCount="22">',
    ]  # fmt: skip
    for kind, (p, q) in (poses or {}).items():
        lines.append(f'<frame time="0" ms="0" type="{kind}">{_words("orientation", q)}{_words("position", p)}</frame>')
    for i, (p, q) in enumerate(zip(position, orientation, strict=True)):
        own = round(i * 1000.0 / rate)
        more = "" if joints is None else _words("jointAngle", joints[i])
        more += "" if centre is None else _words("centerOfMass", centre[i])
        lines.append(
            f'<frame time="{own}" index="{i}" tc="00:00:00:00" ms="{ms + own}" type="normal">\n'
            f"{_words('orientation', q)}{_words('position', p)}<footContacts>1 1 1 1</footContacts>{more}</frame>"
        )
    return "\n".join([*lines, "</frames>", "</subject>", '<securityCode code="0"/>', "</mvnx>", ""])


def _words(name: str, values: Array) -> str:
    return f"<{name}>{' '.join(f'{value:.6f}' for value in np.ravel(values))}</{name}>\n"


def of_suit(skeleton: Skeleton, rotation: Array, translation: Array) -> tuple[Array, Array]:
    """MVN's segments, (n, 23, 3) m and (n, 23, 4), of a suit's joints (n, 59, 4) and (n, 59, 3): by matrices."""
    from scipy.spatial.transform import Rotation

    R, p = np.empty((*rotation.shape[:2], 3, 3)), np.empty(translation.shape)
    for i, up in enumerate(skeleton.parents):
        local = matrices(rotation[:, i])
        if up < 0:
            R[:, i], p[:, i] = local, translation[:, i]
        else:
            R[:, i] = R[:, up] @ local
            p[:, i] = p[:, up] + np.einsum("nij,nj->ni", R[:, up], translation[:, i])
    at = [skeleton.names.index(JOINT_OF[name]) for name in SEGMENTS]
    turned = Rotation.from_matrix((_TO_MVN @ R[:, at] @ _TO_MVN.T).reshape(-1, 3, 3)).as_quat(scalar_first=True)
    return p[:, at] @ _TO_MVN.T, turned.reshape(len(rotation), len(at), 4)
