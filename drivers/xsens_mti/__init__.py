"""Xsens MTi inertial sensors on a serial line: orientation, acceleration, rate of turn (Xbus, MTData2)."""

from srl.drivers.xsens_mti.driver import XsensMti, XsensMtiConfig

__all__ = ["XsensMti", "XsensMtiConfig"]
