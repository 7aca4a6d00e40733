"""A run live for Foxglove's app (`srl run --foxglove`), a process beside the loop."""
