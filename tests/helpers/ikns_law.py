"""The law `ikns` by itself, with the arm whose null space is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.control import bound
from helpers.null_space_arm import Arm
from srl.control.ikns.law import Ikns, IknsConfig
from srl.runtime.contracts.signals import Array

DT = 0.01


def law(file: Path, **options: Any) -> Ikns:
    return bound(Ikns("ikns", IknsConfig(calibration=str(file), **options)))


def put(law: Ikns, arm: Arm, q: Array) -> None:
    law.input["angles"][:] = q
    law.input["hand"][:] = (*arm.pose(q).translation, 1.0, 0.0, 0.0, 0.0)


def follow(law: Ikns, arm: Arm, qs: Array) -> Array:
    """c (T, k) over a motion, from a reset at its beginning."""
    put(law, arm, qs[0])
    law.reset()
    found = [law.output["c"].copy()]
    for q in qs[1:]:
        put(law, arm, q)
        before = law.output["c"].copy()
        law.update(DT)
        assert law.output["c_rate"] == pytest.approx((law.output["c"] - before) / DT)
        found.append(law.output["c"].copy())
    return np.array(found)
