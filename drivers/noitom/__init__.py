"""Noitom Perception Neuron suits, through Axis Neuron or Axis Studio."""

from srl.drivers.noitom.config import NoitomConfig
from srl.drivers.noitom.driver import Noitom

__all__ = ["Noitom", "NoitomConfig"]
