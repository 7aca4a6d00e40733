"""Short cuts for tests of the simulated world and its fakes."""

from __future__ import annotations

import numpy as np

from runtime.contracts.driver import Driver
from sim.augmented_hand import AugmentedHand, AugmentedHandConfig

MS = 1_000_000  # ns


def world(seed: int = 1, **options: object) -> AugmentedHand:
    """An augmented hand with the options a profile would give."""
    return AugmentedHand(AugmentedHandConfig.model_validate(options), seed)


def bind(driver: Driver) -> Driver:
    """Gives a driver arrays, as the runtime does."""
    driver.bind(
        {signal.name: np.zeros(signal.shape) for signal in driver.states},
        {signal.name: np.zeros(signal.shape) for signal in driver.commands},
    )
    return driver
