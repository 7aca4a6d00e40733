"""Franka arms over the Franka Control Interface (FCI): Panda (FER) and Franka Research 3 (FR3)."""

from srl.drivers.panda.driver import Panda

__all__ = ["Panda"]
