"""The figures of Giammarino et al., 2022: Tables I and II, the text's statements on Figs. 6, 7, 9 and 10, and errata.

HR is the person with the robot, H the person alone; S1 to S12 are the subjects of both studies. For each measure the
first row of a table is HR (white), the second H (grey).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from srl.studies.toolkit.tables import Difference, Measure, Printed, Table

CONDITIONS: Final = ("HR", "H")
SUBJECTS: Final = tuple(f"S{i}" for i in range(1, 13))
HOLES: Final = 20

TABLE_I: Final = Table(
    "Prolonged manipulation (Table I)",
    SUBJECTS,
    CONDITIONS,
    (
        Measure(
            "N_err",
            "errors",
            "number of errors",
            {"HR": (0, 0, 0, 0, 1, 0, 1, 1, 2, 2, 0, 0), "H": (2, 1, 0, 2, 4, 0, 1, 0, 4, 0, 0, 1)},
        ),
        Measure(
            "T",
            "s",
            "completion time",
            {
                "HR": (177, 207, 143, 184, 177, 173, 174, 148, 223, 209, 178, 176),
                "H": (128, 122, 114, 135, 124, 122, 122, 141, 155, 143, 126, 124),
            },
        ),
    ),
)
PRINTED_I: Final[Mapping[str, Printed]] = {
    "N_err": Printed({"HR": (0.58, 0.79), "H": (1.25, 1.48)}, None),
    "T": Printed({"HR": (180.75, 23.25), "H": (129.58, 11.64)}, 0.001),
}

TABLE_II: Final = Table(
    "Overhead drilling (Table II)",
    SUBJECTS,
    CONDITIONS,
    (
        Measure(
            "N_Hl",
            "holes",
            "number of holes completed, of 20",
            {"HR": (HOLES,) * 12, "H": (10, 20, 11, 10, 13, 13, 20, 6, 6, 14, 13, 20)},
        ),
        Measure(
            "T",
            "s",
            "completion time for each hole completed",
            {
                "HR": (12.93, 9.20, 10.75, 9.46, 9.67, 10.68, 9.90, 11.00, 9.70, 8.75, 9.10, 9.30),
                "H": (8.00, 7.25, 7.91, 7.30, 7.46, 7.92, 7.35, 8.50, 8.67, 7.36, 7.57, 6.85),
            },
        ),
        Measure(
            "N_err",
            "errors",
            "number of errors",
            {"HR": (0, 1, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0), "H": (2, 7, 3, 0, 0, 1, 4, 0, 0, 1, 0, 8)},
        ),
    ),
)
PRINTED_II: Final[Mapping[str, Printed]] = {
    "N_Hl": Printed({"HR": (20, 0), "H": (13, 4.93)}, 0.01),
    "T": Printed({"HR": (10.04, 1.15), "H": (7.68, 0.53)}, 0.001),
    "N_err": Printed({"HR": (0.42, 0.51), "H": (2.17, 2.82)}, 0.01),
}

# Figures 6 and 9 (NASA-TLX), 7 and 10 (mean sEMG over the task): the level below which the sign test's p is said to
# be; None if the text says it isn't significant. Where there is a level, HR is the lower one. The subjects' values
# aren't printed.
WORKLOAD_I: Final[Mapping[str, float | None]] = {
    "mental_demand": None,
    "physical_demand": 0.001,
    "temporal_demand": None,
    "performance": None,
    "effort": None,
    "frustration": None,
}
WORKLOAD_II: Final[Mapping[str, float | None]] = {
    "mental_demand": None,
    "physical_demand": 0.001,
    "temporal_demand": None,
    "performance": 0.01,
    "effort": 0.001,
    "frustration": 0.001,
}
ACTIVITY_I: Final[Mapping[str, float | None]] = {
    "deltoid_anterior": 0.001,
    "deltoid_posterior": None,
    "biceps": 0.01,
    "triceps": None,
}
ACTIVITY_II: Final[Mapping[str, float | None]] = dict.fromkeys(ACTIVITY_I, 0.001)

# Printed figures that differ from those of the subjects' own rows, computed to the decimals shown. Besides, the
# discussion says that in overhead drilling nobody made more errors with the robot: S8 and S9 did.
ERRATA_I: Final = (Difference("T", "H", "mean", 129.58, 129.67), Difference("T", "H", "deviation", 11.64, 11.59))
ERRATA_II: Final = (
    Difference("N_Hl", "H", "deviation", 4.93, 4.94),
    Difference("T", "H", "deviation", 0.53, 0.54),
    Difference("N_err", "", "p", 0.01, 0.29),
)
