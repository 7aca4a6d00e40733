"""Short cuts for tests of the simulated world and its fakes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World, WorldConfig
from srl.runtime.models.models import Model, context
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.sim.parts.hand.servos import Servos
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000  # ns
WORN = {"parent": "hand/base", "position": [0, -0.020, -0.030], "quaternion": [0.5, -0.5, 0.5, 0.5]}  # as sixth-finger


class HandCell(Cell):
    """A cell with one hand; its servos by number, in the order of the fingers."""

    def __init__(self, config: CellConfig, seed: int) -> None:
        super().__init__(config, seed)
        self.hand = self.part(HumanHandPart, "hand")
        self.servos = Servos(self)

    def set_servo(self, servo: int, target: float | None, at: int = 0) -> None:
        self.servos.set({self.servos.names[servo]: target}, at)

    def servo_targets(self) -> Array:
        return np.array([*self.servos.targets().values()])

    def finger_position(self) -> Array:
        """The angles of the first finger's joints."""
        return self.truth_arrays["finger_position"].copy()


class Elsewhere(World):
    """A world that is no cell."""

    def __init__(self) -> None:
        super().__init__(WorldConfig(), seed=1)

    def advance(self, until: int) -> None:
        self.time = until

    def save(self) -> Array:
        return np.zeros(0)

    def restore(self, state: Array) -> None:
        pass


def world(
    seed: int = 1,
    *,
    hand: Mapping[str, Any] | None = None,
    fingers: Sequence[Mapping[str, Any]] = ({},),
    models: Mapping[str, Model] | None = None,
    **options: Any,
) -> HandCell:
    """A hand that wears fingers, with the options that a profile would give.

    Args:
        hand: options of the part `hand`; `wearer` may stand beside it.
        fingers: options of each finger; `name` is the part's (default: finger).
        models: the profile's.
        options: the cell's; `parts` has further ones, such as objects.
    """
    wearer = options.pop("wearer", None)
    parts: dict[str, Any] = {"hand": {"part": "human-hand"} | dict(hand or {}) | ({"wearer": wearer} if wearer else {})}
    for finger in fingers:
        own = {key: value for key, value in finger.items() if key != "name"}
        parts[finger.get("name", "finger")] = {"part": "robotic-finger", "at": WORN} | own
    options["parts"] = parts | options.pop("parts", {})
    return HandCell(CellConfig.model_validate(options, context=context(models or {})), seed)


def bind(driver: Driver) -> Driver:
    """Gives a driver arrays, as the runtime does."""
    driver.bind(
        {signal.name: np.zeros(signal.shape) for signal in driver.states},
        {signal.name: np.zeros(signal.shape) for signal in driver.commands},
    )
    return driver
