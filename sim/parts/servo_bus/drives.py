"""The motors of a chain at their shafts, with the electronics that drive them: what all kinds have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from srl.runtime.contracts.signals import Array

Row = Array
"""(n,) float64, a value of each motor that is part of the state."""


class Drives(ABC):
    """All motors of a chain. What a class annotates as `Row` is a row of its state, in this order.

    Attributes:
        n: number of motors.
        voltage: (n,) V, of their supplies.
        torque: (n,) 0 or 1: whether they are driven; temperature: (n,) degC; current: (n,) A.
        torque_constant: (n,) N m/A.
        inertia: (n,) kg m^2, of the rotors at the output shafts.
        friction: (n,) N m, dry.
        position, velocity: (n,) rad, rad/s: the shafts' true motion, as last measured.
        state: (rows, n).
    """

    torque: Array
    temperature: Array
    current: Array
    torque_constant: Array
    inertia: Array
    friction: Array

    def __init__(self, n: int, voltage: Array | float, timestep: float) -> None:
        """`voltage`: V, of all or (n,) of each; `timestep`: s, of the physics."""
        self.n, self._dt = n, timestep
        self.voltage = np.full(n, voltage, float)
        kinds = [getattr(cls, "__annotations__", {}) for cls in reversed(type(self).__mro__)]
        rows = dict.fromkeys(name for kind in kinds for name, what in kind.items() if what == "Row")
        self.state = np.zeros((len(rows), n))
        for name, row in zip(rows, self.state, strict=True):
            setattr(self, name, row)
        self.position, self.velocity = np.zeros(n), np.zeros(n)

    @property
    @abstractmethod
    def drag(self) -> Array:
        """(n,) N m s/rad, the present drag at the shafts."""

    @abstractmethod
    def fold(self, i: int) -> None:
        """Has motor `i` count within one turn, or know its turns."""

    @abstractmethod
    def step(self) -> Array:
        """Runs all drives once; returns the torques (n,), N m, of which `drag` times speed is still to be taken."""

    def measure(self, position: Array, velocity: Array) -> None:
        """Takes the shafts' true angles (rad) and speeds (rad/s)."""
        self.position[:], self.velocity[:] = position, velocity

    def save(self) -> Array:
        """The whole state, of fixed size."""
        return np.concatenate([self.state.ravel(), self.position, self.velocity])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        size = self.state.size
        self.state[...] = state[:size].reshape(self.state.shape)
        self.position[:], self.velocity[:] = state[size : size + self.n], state[size + self.n :]
