"""Xsens suits, through MVN Analyze or Animate's network streamer."""

from drivers.xsens_mvn.config import MvnConfig
from drivers.xsens_mvn.driver import XsensMvn

__all__ = ["MvnConfig", "XsensMvn"]
