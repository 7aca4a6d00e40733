"""The numbers that our commands carry, for one connection: whose they are, and which of them were answered.

The nonce names the program that obeys them. The sequence number counts them; the program sends it back once it has
taken the command.
"""

from __future__ import annotations

import secrets
from typing import Final

from srl.drivers.ur import registers
from srl.drivers.ur.registers import Mode

REST: Final = (0.0,) * 6  # the values of commands that have none


class Numbering:
    """See the module's docstring.

    Attributes:
        nonce: number of the program that obeys; 0 before there is one.
        sequence: number of the newest command.
        stop_frames: a STAY command that the program takes whatever came before it; empty before there is a program.
    """

    def __init__(self, recipe: int, cycles: int) -> None:
        """`recipe`: number of the input recipe. `cycles`: control cycles for which a command is valid."""
        self._recipe, self._cycles = recipe, cycles
        self.nonce = 0
        self.sequence = 1
        self.stop_frames: tuple[bytes, ...] = ()

    def renew(self) -> int:
        """Begins anew, for a new program. Returns its nonce."""
        self.nonce = secrets.randbelow(registers.LAST) + 1
        self.sequence = secrets.randbelow(registers.LAST) + 1
        # No command has number 0, so the program takes this one whatever came before it.
        self.stop_frames = (registers.command(self._recipe, self.nonce, Mode.STAY, 0, 0, REST),)
        return self.nonce

    def adopt(self, nonce: int, sequence: int) -> None:
        """Goes on with the numbers of an earlier program; `sequence`: the newest command that it took."""
        self.nonce, self.sequence = nonce, sequence

    def next(self, mode: Mode, values: list[float] | tuple[float, ...] = REST) -> bytes:
        """Returns the next command: a complete data message. `values`: (6,), rad or rad/s."""
        self.sequence = self.sequence % registers.LAST + 1
        return registers.command(self._recipe, self.nonce, mode, self.sequence, self._cycles, values)

    def take_back(self) -> None:
        """Frees the newest command's number: it didn't leave."""
        self.sequence = (self.sequence - 2) % registers.LAST + 1

    def unanswered(self, taken: int) -> int:
        """Returns how many commands the program hasn't answered; `taken`: the number that it sent back last."""
        return (self.sequence - taken) % registers.LAST
