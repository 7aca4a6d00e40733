"""The recorder: a process that writes every row of a run to rerun files. Also the pictures."""
