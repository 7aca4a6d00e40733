"""`strap-base` with the belt's sensor and with four capture systems, on one walking wearer at once, simulated.

`-s` prints the table of docs/capture-systems.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.four_systems import SYSTEMS, profile
from helpers.worn_arm import FOLDER
from ruamel.yaml import YAML

from srl.runtime.contracts.rotation import Pose, inverted
from srl.testing import Lab

pytestmark = pytest.mark.slow
WORN: Pose = (-0.15, 0.02, 0.1, 0.5, -0.5, -0.5, -0.5)  # of `strap-jog`: the plate in the spine
SETTLED = 300  # rows of 5 s: the person walks, and the compensation is there


def keys() -> dict[str, Any]:
    """`strap-jog` with the four systems beside its two sensors, and a law for each."""
    plain = YAML(typ="safe", pure=True).load(FOLDER / "strap-jog.yaml")
    plain["devices"] |= plain.pop("choices")["imu"]["bno085"]["devices"]
    del plain["imu"]
    four = profile("walk")
    (law,) = plain["controllers"]
    x, y, z, *q = inverted(WORN)
    plain["frames"] |= {
        "suit": four["frames"]["suit"],
        "spine": {"parent": "plate", "position": [x, y, z], "quaternion": q},
    }
    plain["devices"] |= {name: four["devices"][name] for name in SYSTEMS}
    plain["sim"]["devices"] |= {name: four["sim"]["devices"][name] for name in SYSTEMS}
    suits = [made for made in four["controllers"] if made["use"] == "suit-joints"]
    by_suit = []
    for name in SYSTEMS:
        owner = "noitom" if name == "noitom" else f"{name}_suit"
        wires = {k: v for k, v in law["in"].items() if k != "body"} | {"rotation": f"{owner}.rotation"}
        by_suit.append(law | {"name": f"by-{name}", "reference": "suit", "in": wires, "out": {}})
    plain["controllers"] = [*suits, law, *by_suit]
    return plain


@pytest.mark.exhaustive
def test_the_tilt_of_the_strap_is_the_same_by_any_of_them() -> None:
    with Lab(keys()) as lab:
        lab.setpoint("client.position", [0.0, -0.2, 0.1, -0.6, 0.01, 0.1, 0.2])
        lab.run(0.3)
        lab.start()
        lab.run(5.0)
        run = {name: lab.layout.value(lab.rows, name) for name in lab.layout.fields}
    true = np.rad2deg(run["world.straps_tilt"][SETTLED:, :2])
    print(f"\nroll and pitch, rms {np.sqrt((true**2).sum(axis=1).mean()):.2f} degrees; off by, degrees rms:")
    for name in ("strap", *(f"by-{system}" for system in SYSTEMS)):
        found = np.rad2deg(run[f"{name}.tilt"][SETTLED:, :2])
        off = np.sqrt(((found - true) ** 2).sum(axis=1).mean())
        print(f"{name:12} {off:.2f}")
        assert run[f"{name}.active"][SETTLED:].min() == 1.0
        assert off < 0.8
    assert np.sqrt((true**2).sum(axis=1).mean()) > 1.0
