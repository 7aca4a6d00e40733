"""Recordings: a process that writes every row of a run to rerun files, and what reads them back."""
