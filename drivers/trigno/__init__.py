"""Delsys Trigno wireless surface EMG."""

from drivers.trigno.driver import Trigno, TrignoConfig

__all__ = ["Trigno", "TrignoConfig"]
