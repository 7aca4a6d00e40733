"""Vibration motors in the simulated world, and their wearer."""
