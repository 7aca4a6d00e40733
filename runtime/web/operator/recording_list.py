"""`python -m srl.runtime.web.operator.recording_list FOLDER PROFILE`: the recordings of a profile as JSON.

They are those of `srl recordings`. Nothing here changes one. The panel's server runs it as a process of its own, behind
everything else.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts.errors import SrlError
from srl.runtime.recording.index import entries

MOST: Final = 50  # recordings that a page is told, the newest


def shelf(folder: Path, profile: str) -> dict[str, Any]:
    """The newest recordings of a profile in a folder and those below it; it may take long, as new ones are read.

    Returns:
        `rows`: name, date, seconds, bytes, stop, fault, problem, remedy of each, the newest first. `more`: how many
        aren't told. `words`: why there are none, or what couldn't be read.
    """
    problems: list[str] = []
    try:
        found = [e for e in entries(folder, report=problems.append) if e.summary.profile == profile]
    except SrlError as error:
        return {"rows": [], "more": 0, "words": str(error)}
    rows = [
        {
            "name": entry.name, "date": entry.summary.date, "seconds": entry.summary.seconds, "bytes": entry.size,
            "stop": entry.summary.stop, "fault": entry.summary.fault, "problem": entry.summary.problem,
            "remedy": entry.summary.remedy, "simulated": entry.summary.simulated, "partly": list(entry.summary.partly),
        }
        for entry in reversed(found)
    ]  # fmt: skip
    words = "; ".join(problems)
    if not rows:
        words = words or f"No recordings of {profile} in {folder}. `srl run --record FILE` makes one."
    return {"rows": rows[:MOST], "more": max(len(rows) - MOST, 0), "words": words}


if __name__ == "__main__":
    os.nice(10)
    print(json.dumps(shelf(Path(sys.argv[1]), sys.argv[2])))
