"""Records that `srl calibrate` writes and a driver reads (docs/extending.md)."""

from srl.runtime.contracts.glove_record import GloveRecord
from srl.runtime.contracts.servo_record import Joint as ServoJoint
from srl.runtime.contracts.servo_record import ServoRecord

__all__ = ["GloveRecord", "ServoJoint", "ServoRecord"]
