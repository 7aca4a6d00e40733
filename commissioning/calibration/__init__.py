"""Calibration: the engine (steps, samples, refusals, report), and a folder for each kind."""
