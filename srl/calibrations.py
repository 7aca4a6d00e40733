"""Files that `srl calibrate` writes, and marks in its rows: what drivers and laws need of them (docs/extending.md).

`parse` makes a record of a file's content, and refuses a file whose hash says that it was changed.
"""

from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.glove_record import GloveRecord
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.servo_record import Joint as ServoJoint
from srl.runtime.contracts.servo_record import ServoRecord
from srl.runtime.models.record_file import RecordError, parse

__all__ = [
    "BaseModel",
    "GloveRecord",
    "Indices",
    "MarkLaw",
    "MarkedSamples",
    "Options",
    "RecordError",
    "ServoJoint",
    "ServoRecord",
    "parse",
]
