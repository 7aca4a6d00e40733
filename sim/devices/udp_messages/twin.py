"""The twin of a program that sends numbers by UDP, to the port of the profile on this host."""

from __future__ import annotations

from typing import Final

from srl.drivers.udp_messages.protocol import json_message, osc_message
from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.datagram_twin import DatagramTwin
from srl.sim.devices.udp_messages.fake import FakeUdpMessages

_MOST: Final = 20  # samples sent at once, after the twin was busy


class UdpMessagesTwin(DatagramTwin):
    """Each sample of the fake is a datagram."""

    def __init__(self, fake: FakeUdpMessages) -> None:
        super().__init__(fake, _MOST, fake.messages.port)
        self.sender = fake

    def message(self, number: int, values: Array) -> bytes:
        config, numbers = self.sender.messages, self.sender.numbers
        content = dict(zip(numbers.places, numbers.numbers(values), strict=True))
        if config.sequence is not None:
            content[config.sequence] = number
        if config.time is not None:
            content[config.time] = self.sender.taken_at(number) * 1e-9
        return json_message(content) if config.format == "json" else osc_message(content)
