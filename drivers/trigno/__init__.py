"""Delsys Trigno wireless surface EMG."""

from srl.drivers.trigno.driver import Trigno, TrignoConfig

__all__ = ["Trigno", "TrignoConfig"]
