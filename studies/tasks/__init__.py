"""Trials as tasks: each is a pure function of names and numbers, run on any machine, kept as soon as it is there."""
