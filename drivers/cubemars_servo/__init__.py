"""CubeMars AK actuators in servo mode: extended identifiers, periodic status."""

from drivers.cubemars_servo.driver import CubemarsServo

__all__ = ["CubemarsServo"]
