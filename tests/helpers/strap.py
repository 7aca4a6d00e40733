"""A worn arm of seven axes: three that meet in a shoulder, an elbow, a slide, two of the wrist."""

from __future__ import annotations

from typing import Any

ARM: dict[str, dict[str, Any]] = {
    "j1": {"axis": [0, 1, 0]},
    "j2": {"axis": [0, 0, 1]},
    "j3": {"axis": [1, 0, 0], "link": [0.22, 0, 0]},
    "j4": {"axis": [0, 1, 0], "link": [0.1, 0, 0]},
    "j5": {"axis": [1, 0, 0], "link": [0.1, 0, 0], "slides": True, "lower": -0.04, "upper": 0.04},
    "j6": {"axis": [0, 0, 1], "link": [0.06, 0, 0]},
    "j7": {"axis": [0, 1, 0], "link": [0.1, 0, 0]},
}
"""For the law `strap-base`. At zero it is stretched along x, 0.58 m."""

HOME = [0.4, 0.3, 0.0, -0.9, 0.0, 0.2, 0.3]
"""A posture away from limits and singularities; rad, and m for j5."""
