"""MIT-mode actuators on CAN: CubeMars AK and Damiao."""

from srl.drivers.mit_can.driver import MitCan

__all__ = ["MitCan"]
