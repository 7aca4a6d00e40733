"""Noitom Perception Neuron suits, through Axis Neuron or Axis Studio."""

from drivers.noitom.config import NoitomConfig
from drivers.noitom.driver import Noitom

__all__ = ["Noitom", "NoitomConfig"]
