"""Any stream of the Lab Streaming Layer (LSL) as a device: EMG, EEG, gaze, motion capture."""

from srl.drivers.lsl.config import LslConfig, LslSignal, LslStream
from srl.drivers.lsl.driver import Lsl

__all__ = ["Lsl", "LslConfig", "LslSignal", "LslStream"]
