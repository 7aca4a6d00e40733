"""Runtime for supernumerary robotic limbs. What a package that extends it, or a program that uses it, imports:

    from srl import Controller, ControllerConfig, Driver, DeviceConfig, Sensor, Signal, Command

These names, and those of the modules below, stay in place when the inner ones move. docs/extending.md shows a whole
package written with them.

    srl.links         serial ports, sockets and CAN buses by URL
    srl.client        a client of a running instance's bus, and its TLS
    srl.recordings    reads recordings
    srl.simulation    fakes, worlds and their parts;  srl.twins: wire-level twins
    srl.testing       tests of drivers, laws, parts and profiles
    srl.robots        descriptions of robots, and their Pinocchio models
    srl.trials        trials of studies as tasks;  srl.participant: the participant's screen
    srl.calibrations  files and marks of a calibration: what drivers and laws need
    srl.calibrating   what a kind of calibration of your own is made of

Nothing is loaded before it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from srl.runtime.contracts import terms as terms
    from srl.runtime.contracts import transforms as transforms
    from srl.runtime.contracts import wearer as wearer
    from srl.runtime.contracts.clearance import Braking as Braking
    from srl.runtime.contracts.clearance import Clearance as Clearance
    from srl.runtime.contracts.clearance import ClearanceConfig as ClearanceConfig
    from srl.runtime.contracts.controller import Controller as Controller
    from srl.runtime.contracts.controller import ControllerConfig as ControllerConfig
    from srl.runtime.contracts.controller import Parameter as Parameter
    from srl.runtime.contracts.driver import DeviceConfig as DeviceConfig
    from srl.runtime.contracts.driver import Driver as Driver
    from srl.runtime.contracts.driver import Health as Health
    from srl.runtime.contracts.driver import Sensor as Sensor
    from srl.runtime.contracts.driver import Traffic as Traffic
    from srl.runtime.contracts.errors import DeviceError as DeviceError
    from srl.runtime.contracts.errors import DeviceLostError as DeviceLostError
    from srl.runtime.contracts.errors import HostError as HostError
    from srl.runtime.contracts.errors import NoAnswerError as NoAnswerError
    from srl.runtime.contracts.errors import ProfileError as ProfileError
    from srl.runtime.contracts.errors import RecordingError as RecordingError
    from srl.runtime.contracts.errors import RequestError as RequestError
    from srl.runtime.contracts.errors import SrlError as SrlError
    from srl.runtime.contracts.errors import WiringError as WiringError
    from srl.runtime.contracts.files import FileOption as FileOption
    from srl.runtime.contracts.files import KeptFile as KeptFile
    from srl.runtime.contracts.files import ProfilePath as ProfilePath
    from srl.runtime.contracts.limb_drives import LimbDrives as LimbDrives
    from srl.runtime.contracts.limb_drives import LimbJoint as LimbJoint
    from srl.runtime.contracts.limb_drives import LimbMotor as LimbMotor
    from srl.runtime.contracts.limb_drives import Question as Question
    from srl.runtime.contracts.per_element import PerElement as PerElement
    from srl.runtime.contracts.signals import Array as Array
    from srl.runtime.contracts.signals import Command as Command
    from srl.runtime.contracts.signals import Kind as Kind
    from srl.runtime.contracts.signals import Limits as Limits
    from srl.runtime.contracts.signals import Signal as Signal
    from srl.runtime.contracts.signals import Stop as Stop
    from srl.runtime.contracts.transforms import Transform as Transform

_FROM = {
    "clearance": ("Braking", "Clearance", "ClearanceConfig"),
    "controller": ("Controller", "ControllerConfig", "Parameter"),
    "driver": ("DeviceConfig", "Driver", "Health", "Sensor", "Traffic"),
    "errors": (
        "DeviceError",
        "DeviceLostError",
        "HostError",
        "NoAnswerError",
        "ProfileError",
        "RecordingError",
        "RequestError",
        "SrlError",
        "WiringError",
    ),
    "files": ("FileOption", "KeptFile", "ProfilePath"),
    "limb_drives": ("LimbDrives", "LimbJoint", "LimbMotor", "Question"),
    "per_element": ("PerElement",),
    "signals": ("Array", "Command", "Kind", "Limits", "Signal", "Stop"),
    "transforms": ("Transform",),
}
_MODULE = {name: module for module, names in _FROM.items() for name in names}

__all__ = [
    "Array",
    "Braking",
    "Clearance",
    "ClearanceConfig",
    "Command",
    "Controller",
    "ControllerConfig",
    "DeviceConfig",
    "DeviceError",
    "DeviceLostError",
    "Driver",
    "FileOption",
    "Health",
    "HostError",
    "KeptFile",
    "Kind",
    "LimbDrives",
    "LimbJoint",
    "LimbMotor",
    "Limits",
    "NoAnswerError",
    "Parameter",
    "PerElement",
    "ProfileError",
    "ProfilePath",
    "Question",
    "RecordingError",
    "RequestError",
    "Sensor",
    "Signal",
    "SrlError",
    "Stop",
    "Traffic",
    "Transform",
    "WiringError",
    "__version__",
    "terms",
    "transforms",
    "wearer",
]


def __getattr__(name: str) -> Any:
    """The public names (PEP 562): imported at their first use."""
    if name in ("terms", "transforms", "wearer"):
        found: Any = import_module(f"srl.runtime.contracts.{name}")
    elif name in _MODULE:
        found = getattr(import_module(f"srl.runtime.contracts.{_MODULE[name]}"), name)
    else:
        raise AttributeError(f"module 'srl' has no attribute '{name}'", name=name, obj=None)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
