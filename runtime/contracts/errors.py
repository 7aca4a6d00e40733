"""Errors a user can act on: each names the place, what is wrong there, and the remedy.

The command line prints `str(error)` and ends with the error's exit code, without a traceback. Any other exception is
a defect of this program, and its traceback is shown.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

UNAVAILABLE = 69
"""Exit code of a run whose device isn't there, which a later try may find (EX_UNAVAILABLE of sysexits.h)."""


def _line(text: str, most: int = 1000) -> str:
    """The text as one line of bounded length: it may quote what a file has."""
    if len(lines := text.splitlines()) > 1:
        text = " ".join(" ".join(lines).split())
    return text if len(text) <= most else f"{text[:most]} ..."


def _sentence(text: str) -> str:
    return text if text.endswith((".", "?", "!")) else f"{text}."


class SrlError(Exception):
    """Something outside this program is wrong.

    Attributes:
        place: where it is wrong ("sixth-finger.yaml: devices.glove.port", "glove (/dev/ttyUSB0)").
        problem: what is wrong and what was expected.
        remedy: what the reader can do about it.
        exit_code: what the command line ends with.
    """

    exit_code = 2

    def __init__(self, place: str, problem: str, remedy: str) -> None:
        self.place, self.problem, self.remedy = _line(place, 400), _line(problem), _line(remedy, 2000)
        super().__init__(self.place, self.problem, self.remedy)

    def __str__(self) -> str:
        return f"{self.place}: {_sentence(self.problem)} {_sentence(self.remedy)}"


class ProfileError(SrlError):
    """The profile's text is wrong: syntax, an unknown key, a value out of its range."""


class MissingError(ProfileError):
    """A profile names a driver, a law or another part that no installed package brings."""


class OptionError(ValueError):
    """What a validator of options raises to give the remedy, too; the profile's reader adds the place.

    Attributes:
        problem, remedy: as in SrlError.
    """

    def __init__(self, problem: str, remedy: str) -> None:
        self.problem, self.remedy = _line(problem), _line(remedy, 2000)
        super().__init__(f"{self.problem}. {self.remedy}")


def refused(error: ValueError) -> tuple[str, str]:
    """Problem and remedy of what somebody's constructor raised."""
    if isinstance(error, OptionError):
        return error.problem, error.remedy
    return str(error) or repr(error), "Correct its options, or its code"


class WiringError(SrlError):
    """The profile's parts don't fit together: an unbound signal, two writers, units that differ."""


class DeviceError(SrlError):
    """A device can't be reached, isn't what the profile says, or refuses a request."""


class DeviceLostError(DeviceError):
    """An open device was lost: the descriptor is closed or the peer hung up."""


class RequestError(SrlError):
    """A client's request can't be carried out."""


class NoAnswerError(RequestError):
    """Nobody answered a client's request. Its problem says whether the request may have been carried out."""


class RecordingError(SrlError):
    """A recording can't be read or written."""


class HostError(SrlError):
    """The host lacks something: a permission, a package, a free name."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """The remedy for an unknown name: the closest valid one, or all of them."""
    names = sorted(set(valid))
    close = difflib.get_close_matches(name, names, n=1)
    listed = ", ".join(names) if names else "none"
    return f"Did you mean '{close[0]}'? Known: {listed}" if close else f"Known: {listed}"
