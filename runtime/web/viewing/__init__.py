"""The operator's panel as a part of a run (`srl run --view`), a process beside the loop."""
