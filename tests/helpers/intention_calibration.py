"""A profile with the law `intention`, and a simulated person without physics who follows a calibration's words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from helpers.acted_calibration import Acted
from helpers.intention import SKELETON
from srl.commissioning.calibration.intention.method import ChannelMap, IntentionMethod
from srl.commissioning.calibration.request import CalibrationRequest
from srl.runtime.contracts.wearer import Perform, Rest
from srl.runtime.ipc.header import CYCLE, LINK_CONNECTED, State
from srl.sim.wearer.people import subject
from srl.sim.wearer.performer import Performer

PROFILE = """
name: suit-intention
rate: 20
devices:
  suit: {driver: noitom, port: "tcp://192.168.10.2:7001"}
  ring: {driver: ring, port: /dev/ttyUSB7}
controllers:
  - use: intention
    recogniser: p07.json
    in: {rotation: suit.rotation, translation: suit.translation}
emergency: [{signal: ring.buttons, element: button}]
sim:
  world: cell
  parts:
    body: {part: body, script: actions, subject: 3}
"""


@dataclass
class Person:
    """What a person does otherwise than told: stays still at `lazy` actions, and isn't measured at `hidden` ones."""

    lazy: set[str] = field(default_factory=set)
    hidden: set[str] = field(default_factory=set)


class Pretender(Acted):
    """Rows of a simulated person, without physics.

    Attributes: `person` may be changed; `rows` so far.
    """

    channel_map: ChannelMap
    period, look = 50_000_000, 10

    def __init__(
        self, person: Person | None = None, actions: str | None = None, number: int = 3, option: Sequence[str] = ()
    ) -> None:
        request = CalibrationRequest("suit.yaml", "intention", "P07", actions=actions, option=option)
        super().__init__(IntentionMethod, request, PROFILE, "suit")
        self.person = person or Person()
        self._body = Performer(subject(number, SKELETON.names), SKELETON)
        self._noise = np.random.default_rng(number)
        self._hidden = False

    def instruct(self, step: Any, instruction: Any) -> None:
        name = instruction.action if isinstance(instruction, Perform) else ""
        self._hidden = name in self.person.hidden
        self._body.instruct(self._t / 20.0, Rest() if name in self.person.lazy else instruction)

    def fill(self, row: Any) -> None:
        hips, rotation = self._body.at(self._t / 20.0)
        row.views["suit.rotation"][:] = np.nan if self._hidden else rotation
        row.views["suit.rotation"][1:, 1:] += self._noise.normal(0.0, 0.001, (58, 3))
        row.views["suit.translation"][:] = self._body.offsets
        row.views["suit.translation"][0] = hips
        row.ints[CYCLE.cycle], row.ints[CYCLE.now], row.ints[CYCLE.state] = self._t, self._t * 50_000_000, State.ACTIVE
        row.words[self.graph.layout.int_names.index("suit.link")] = LINK_CONNECTED
        return row.words.copy()
