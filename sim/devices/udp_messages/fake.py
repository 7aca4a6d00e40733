"""A sender of numbers by UDP, in a simulated world."""

from __future__ import annotations

from srl.drivers.udp_messages import UdpMessages, UdpMessagesConfig
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.numbers import FakeNumbers, FakeNumbersOptions


class FakeUdpMessages(FakeNumbers):
    """See `FakeNumbers`."""

    real = UdpMessages

    def __init__(self, name: str, config: UdpMessagesConfig, world: World, options: FakeNumbersOptions) -> None:
        super().__init__(name, config, world, options)
        self.messages = config
        self.states = config.states()
