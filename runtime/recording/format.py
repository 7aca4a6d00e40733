"""The format of a recording of srl in a .rrd file: the names that the writer and the readers share."""

from __future__ import annotations

from srl.runtime.ipc.events import Level

APPLICATION = "srl"  # rerun's application id
FORMAT = 2
COLUMNS_ONLY = 1  # the format whose columns held every row; blocks replaced them
PROPERTY = "srl"  # the property that holds format and layout
ROWS, BLOCK = "/rows", "srl.Rows"  # the entity of the packed rows (srl.runtime.recording.blocks), and its archetype
LEVELS = {Level.INFO: "INFO", Level.WARNING: "WARN", Level.ERROR: "ERROR"}  # rerun's names of the events' levels
EVENTS, EVENT = "/events", "srl.Event"  # the entity of the loop's events, and its archetype
OLD_EVENTS, OLD_EVENT = "/notes", "srl.Note"  # the same in recordings of srl 0.1.0
