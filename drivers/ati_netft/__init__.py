"""ATI Net F/T and Ethernet Axia force/torque sensors: RDT records over UDP."""

from srl.drivers.ati_netft.driver import AtiNetFt

__all__ = ["AtiNetFt"]
