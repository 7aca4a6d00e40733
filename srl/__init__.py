"""The public API for packages that extend srl: drivers, control laws, simulated devices and worlds.

The names here stay in place when the runtime's own modules move:

    from srl import Controller, ControllerConfig, Driver, DeviceConfig, Sensor, Signal, Command

`srl.links` opens serial ports and sockets. `srl.simulation` has what fakes, twins, worlds and their parts need.
`srl.testing` has what their tests need. docs/extending.md shows a whole package written with them.
"""

from runtime import __version__
from runtime.contracts import transforms
from runtime.contracts.clearance import Braking, Clearance, ClearanceConfig
from runtime.contracts.controller import Controller, ControllerConfig, Parameter
from runtime.contracts.driver import DeviceConfig, Driver, Health, Sensor, Traffic
from runtime.contracts.errors import (
    DeviceError,
    DeviceLostError,
    HostError,
    ProfileError,
    RecordingError,
    RequestError,
    SrlError,
    WiringError,
)
from runtime.contracts.files import FileOption, KeptFile, ProfilePath
from runtime.contracts.per_element import PerElement
from runtime.contracts.signals import Array, Command, Kind, Limits, Signal, Stop
from runtime.contracts.transforms import Transform

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
    "Limits",
    "Parameter",
    "PerElement",
    "ProfileError",
    "ProfilePath",
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
    "transforms",
]
