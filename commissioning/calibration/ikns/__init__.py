"""The calibration of null-space control."""
