"""Quasi-direct-drive actuators on CAN: the motors, and a chain of axes that they drive."""
