"""CubeMars AK actuators in servo mode: extended identifiers, periodic status."""

from srl.drivers.cubemars_servo.driver import CubemarsServo

__all__ = ["CubemarsServo"]
