"""Xsens suits, through MVN Analyze or Animate's network streamer."""

from srl.drivers.xsens_mvn.config import MvnConfig
from srl.drivers.xsens_mvn.driver import XsensMvn

__all__ = ["MvnConfig", "XsensMvn"]
