"""The Trigno SDK server's wire format (sheet delsys_trigno): text commands, and samples of 16 float32. No I/O."""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array

COMMAND_PORT: Final = 50040
EMG_OFFSET: Final = 3  # the EMG port of new and classic sensors is 50043
SLOTS: Final = 16
SAMPLE: Final = 4 * SLOTS  # bytes
END: Final = b"\r\n\r\n"
FRAME: Final = 0.0135  # s, the radio's frame
RATE: Final = 27 / FRAME  # Hz, with UPSAMPLE ON for every sensor
RANGE: Final = 0.011  # V, the widest range
LONGEST: Final = 4096  # greatest number of bytes of an answer


def command(text: str) -> bytes:
    """Encodes one request."""
    return text.encode("ascii") + END


class Answers:
    """Cuts the command channel into answers; a flood without an end mark is discarded.

    Attributes:
        errors: number of such floods.
    """

    def __init__(self) -> None:
        self.errors = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """Returns the answers that `data` completes, without spaces and padding around them."""
        *whole, rest = (self._rest + data).split(END)
        if len(rest) > LONGEST:
            self.errors += 1
            rest = rest[-len(END) :]
        self._rest = rest
        return [text.decode("ascii", "replace").strip(" \0\r\n") for text in whole]


def refused(answer: str) -> bool:
    """Returns whether the server refused a command."""
    return "INVALID COMMAND" in answer or "CANNOT COMPLETE" in answer


class Samples:
    """Cuts the EMG channel into samples.

    The stream has no marks: one extra byte would shift everything after it (TCP loses none). Implausible values show
    this: a block with a value beyond twice the range, or a non-finite one, is discarded as a whole.

    Attributes:
        frames: good samples.
        errors: samples discarded.
    """

    def __init__(self, little: bool = True) -> None:
        self.frames = self.errors = 0
        self._type = np.dtype("<f4" if little else ">f4")
        self._rest = b""

    def feed(self, data: bytes) -> Array:
        """Returns the samples (k, 16) V, oldest first."""
        data = self._rest + data
        end = len(data) - len(data) % SAMPLE
        self._rest = data[end:]
        with np.errstate(invalid="ignore"):  # a signalling NaN is garbage like any other
            values = np.frombuffer(data[:end], self._type).astype(np.float64).reshape(-1, SLOTS)
        if not values.size:
            return values
        if not (np.abs(values) <= 2 * RANGE).all():  # also false for NaN
            self.errors += len(values)
            return values[:0]
        self.frames += len(values)
        return values


def encode(samples: Array, little: bool = True) -> bytes:
    """Encodes samples (k, 16), V, as they are streamed."""
    return np.ascontiguousarray(samples).astype("<f4" if little else ">f4").tobytes()
