"""What decides a grasp with the worn finger, object by object: `python -m srl.studies.ikns.grasp_table [--draws N]`.

Everything is simulated, the hand is an ideal carrier. Conditions change one thing at a time.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns.grasp import Grasp, grasp_trial
from srl.studies.ikns.grasp_cell import SERVO, carried_cell

WEAK: Final = {"stall_torque": 0.14, "no_load_speed": 8.0, "stiffness": 3.0, "damping": 0.05}
"""The standard finger's servo."""
MISSES: Final = (0.005, 0.010, 0.015)
"""m, standard deviation of where the hand takes the object, along each axis."""
_SEED: Final = 13


def one(code: str, **options: Any) -> Grasp:
    """A grasp of one object with an ideal carrier; the options are those of `carried_cell`."""
    lockstep, who, task = carried_cell(code, **options)
    return grasp_trial(lockstep, who, task, YCB[code], watch=who.watch)


def conditions(code: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """What is changed, and the options that change it."""
    friction = YCB[code].friction
    yield "as it is", {}
    for share in (0.7, 1.3):
        yield f"friction of the pads x {share}", {"thing": {"friction": share * friction}}
    for skin in (0.40, 0.84):
        yield f"friction of the skin {skin}", {"hand": {"friction": skin}}
    for c in (0.8, 0.7, 0.6, 0.5):
        yield f"closed to c = {c}", {"squeeze": c}


def main() -> None:
    """Prints the tables: of the conditions, and of how many of the draws succeed when the hand is off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10, help="how often each object is taken when the hand is off")
    draws = parser.parse_args().draws
    for servo in (SERVO, WEAK):
        print(f"servo of {servo['stall_torque']} N m: result, slip in mm")
        for number, (label, _) in enumerate(conditions("A")):
            found = {code: one(code, servo=servo, **[*conditions(code)][number][1]) for code in YCB}
            cells = (f"{code} {g.reason or 'yes'} {1e3 * g.slip:.0f}" for code, g in found.items())
            print(f"  {label}: {', '.join(cells)}")
        for sd in MISSES:
            rng = np.random.default_rng(_SEED)
            count = dict.fromkeys(YCB, 0)
            for _ in range(draws):
                miss = tuple(rng.normal(0.0, sd, 3).tolist())
                for code in YCB:
                    count[code] += one(code, servo=servo, miss=miss).success
            print(f"  off by {1e3 * sd:.0f} mm: {', '.join(f'{code} {n}/{draws}' for code, n in count.items())}")


if __name__ == "__main__":
    main()
