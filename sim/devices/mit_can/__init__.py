"""MIT-mode actuators, simulated: their drives, the fake and the twin."""
