"""Noitom Perception Neuron suits, through Axis Neuron or Axis Studio."""

from drivers.noitom.driver import Noitom, NoitomConfig

__all__ = ["Noitom", "NoitomConfig"]
