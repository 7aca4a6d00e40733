"""Doubts about a profile's calibration files that nothing but the day and the persons' ids tells."""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping
from typing import Final

from srl.runtime.contracts.calibration_content import parse
from srl.runtime.ipc.launch import ANONYMOUS

WORN: Final = {"srl-emg-1": "the electrodes stay on the skin", "srl-suit-1": "the suit stays on"}
"""Until when a file of a format holds, where that is no longer than a session."""


def warnings(files: Mapping[str, bytes], today: datetime.date) -> list[str]:
    """Warnings about files (their content by name), a line each. Files of the simulated person are left out."""
    found, persons = list[str](), dict[str, str]()
    for name, content in files.items():
        record = parse(content)
        if record.get("simulated") is True:
            continue
        whose = record.get("person")
        if isinstance(whose, str) and re.fullmatch(ANONYMOUS, whose):
            persons.setdefault(whose, name)
        until = WORN.get(str(record.get("format")))
        if until is None:
            continue
        try:
            days = (today - datetime.date.fromisoformat(str(record.get("date")))).days
        except ValueError:
            continue
        if days:
            when = f"{days} day{'s' * (days > 1)} ago" if days > 0 else "on a day that hasn't come yet"
            found.append(f"{name}: it was made {when}, and holds only while {until}: calibrate again")
    if len(persons) > 1:
        listed = ", ".join(f"{whose} ({name})" for whose, name in persons.items())
        found.append(f"the files are of {len(persons)} persons: {listed}. `srl run --person` refuses another one's")
    return found
