"""The calibration of a person's muscle signals."""
