"""Figures of Lisini Baldi et al. 2023, as printed; what is wrong with them stands beside them."""

from __future__ import annotations

from typing import Final

RMSE: Final = {  # % of the greatest control value: mean and deviation of ten subjects
    ("ikns", "T1"): (3.35, 0.83),
    ("ikns", "T2"): (5.43, 0.92),
    ("ikns", "T3"): (4.50, 1.54),
    ("gamepad", "T1"): (4.13, 0.76),
    ("gamepad", "T2"): (4.98, 1.33),
    ("gamepad", "T3"): (4.15, 1.10),
}
# The text prints t(29) = 0.27 with p = 0.979; t(29) = 0.27 gives 0.789. 29 degrees of freedom take the ten subjects'
# three curves as independent.
PAIRED_T: Final = {"t": 0.27, "freedom": 29, "p": 0.979}
SHAPIRO_WILK: Final = 0.352
GRASPS: Final = {"ikns": (88, 100)}
SECONDS: Final = {"ikns": (8.94, 3.26), "ring": (6.34, 0.71)}
MEDIAN_INCREASE: Final = 1.44  # s, of ikns against the ring; exact sign test, p < 0.01
LIMIT: Final = 20.0  # s a grasp may take
