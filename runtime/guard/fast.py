"""A guard's ordinary cycles in C, as the guards see them."""

from __future__ import annotations

from abc import ABC, abstractmethod

from srl.runtime.contracts.signals import Array


class Fast(ABC):
    """A guard's ordinary cycles in C (runtime/guard/compiled.py). Each method leaves the guard as Python would."""

    @abstractmethod
    def step(self, desired: Array, desired_velocity: Array | None, dt: float) -> int:
        """A cycle of `CommandGuard.step`: 0 done, 1 done and limited, -1 nothing done and left: Python must."""

    @abstractmethod
    def taken(self, transmitted: bool, dt: float) -> bool:
        """A cycle of `SentTracker.compare` in which all was sent as applied; False: nothing done, Python must."""

    @abstractmethod
    def leave(self) -> None:
        """Gives the guard its state back, before Python computes a cycle."""

    @abstractmethod
    def tell(self) -> None:
        """Gives the guard's tracker its state back."""

    @abstractmethod
    def forget(self) -> None:
        """Drops all state: the guard begins again."""
