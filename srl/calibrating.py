"""What a kind of calibration of your own is made of (docs/extending-calibration.md). Loads matplotlib."""

from srl.commissioning.calibration.calibrated_device import DeviceMethod
from srl.commissioning.calibration.guided import Bar, Procedure, StepProcedure, View
from srl.commissioning.calibration.held_still import HeldStill, block_motion, held_poses, still_bar
from srl.commissioning.calibration.marks import IDLE, held, joined
from srl.commissioning.calibration.method import FittedMethod, Method
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.profile_subset import elements, find, subset_for
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.run_channels import RunChannels, words

__all__ = [
    "IDLE",
    "Bar",
    "DeviceMethod",
    "FittedMethod",
    "HeldStill",
    "Method",
    "Procedure",
    "Result",
    "RunChannels",
    "StepProcedure",
    "View",
    "block_motion",
    "elements",
    "find",
    "held",
    "held_poses",
    "joined",
    "plt",
    "save",
    "still_bar",
    "subset_for",
    "words",
]
