"""A hand that a camera sees: 21 landmarks, by a program of its own that sends them by UDP."""

from srl.drivers.hand_camera.config import HandCameraConfig
from srl.drivers.hand_camera.driver import HandCamera

__all__ = ["HandCamera", "HandCameraConfig"]
