"""rerun's live viewer as a page of ours (`srl run --view`), a process beside the loop."""
