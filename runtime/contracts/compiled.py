"""Laws and guards in C: the extension `srl.runtime._compiled`, and how a law is bound to it (docs/compiled.md).

The Python law is the specification and the fallback. It keeps its options, its checks, its reset and its figures. The C
function computes the ordinary cycle. Where it meets anything else (a NaN, a pause, a switched load), it does nothing
and returns RARE, and Python computes that cycle from the same state.
"""

from __future__ import annotations

import importlib
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from srl.runtime import __version__
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array

Backend = Literal["auto", "c", "python"]
Step = Callable[..., int]
PYTHON: Final = "python"
_NAME: Final = "srl.runtime._compiled"
_PACKAGE: Final = Path(__file__).resolve().parents[1]  # without the link that leads to it
_ELF: Final = struct.Struct("<6s34xQ10xHH")  # 64 bit: magic; where the sections' headers are, of what size, how many


def _load() -> tuple[Any, str, bool]:
    """The extension, or None with why, and whether there is one that isn't the package's."""
    try:
        spec = find_spec(_NAME)
        if spec is not None and spec.origin is not None and (wrong := unfit(Path(spec.origin))):
            return None, wrong, True
        found = importlib.import_module(_NAME)
    except (ImportError, OSError) as error:  # built without a compiler, or for another machine
        return None, f"the laws in C aren't installed: {error}", False
    old = stale(found)
    return (None, old, True) if old else (found, "", False)


class NotCompiledError(Exception):
    """Why a law or guard is computed in Python; its text is for people."""


def missing() -> str:
    """Why no C is used here; "" if it is."""
    return _missing


def is_old() -> bool:
    """Whether there is C here, but another than that of the package's Python, or not all of it."""
    return _old


def unfit(file: Path, package: Path = _PACKAGE) -> str:
    """Why this file isn't even to be loaded as the package's C; "" if it may be.

    Another copy of the package may be installed beside a checkout without C. What is cut off ends the process that
    loads it.
    """
    if not file.parent.samefile(package):
        return f"the C here is of another copy of the package: {file.parent}"
    with file.open("rb") as opened:
        head = opened.read(_ELF.size)
    if len(head) == _ELF.size:
        magic, at, size, count = _ELF.unpack(head)
        if magic == b"\x7fELF\2\1" and file.stat().st_size < at + size * count:  # they are the last
            return f"the C here is cut off: {file.name}"
    return ""


def stale(found: Any, sources: Path = _PACKAGE.parent / "native") -> str:
    """Why this C isn't that of the package's Python, so that it would compute something else; "" if it is.

    Args:
        found: the extension.
        sources: where its sources are, if the package is a checkout.
    """
    version = getattr(found, "version", "")
    if version != __version__:
        return f"the C here is of {version or 'an older version'}, the package of {__version__}"
    built = Path(found.__file__).stat().st_mtime
    newer = sorted(path.name for path in sources.glob("*.[ch]") if path.stat().st_mtime > built)
    return f"the C here is older than its source: {', '.join(newer)}" if newer else ""


extension, _missing, _old = _load()


def available() -> str:
    """What computes laws that have a C version: "c, COMPILER" or "python"."""
    return PYTHON if extension is None else f"c, {extension.compiler}"


def bind(name: str, *arrays: Array) -> Step:
    """The C function of this name over these arrays, which it holds on to.

    Returns:
        `f(dt, flag=False)`: 0 done, 1 done and limited (of a guard), -1 nothing done: Python must.

    Raises:
        NotCompiledError: there is no C here, or an older one, or the arrays are of a kind or size that it doesn't take.
    """
    if extension is None:
        raise NotCompiledError(_missing)
    try:
        step: Step = extension.bind(name, *arrays)
    except KeyError:
        raise NotCompiledError(f"the C here is older than '{name}': install the package again") from None
    except (TypeError, ValueError, BufferError) as error:
        raise NotCompiledError(str(error)) from None
    return step


def bind_or_python(name: str, *arrays: Array) -> Step:
    """As `bind`; where that can't be: `undone`."""
    try:
        return bind(name, *arrays)
    except NotCompiledError:
        return undone


def undone(dt: float, flag: bool = False) -> int:
    """In place of a C function: -1, so Python must, each time."""
    return -1


def numbers(*values: Any) -> Array:
    """One contiguous array of all values, in order: the constants of a law."""
    return np.concatenate([np.ravel(np.asarray(value, np.float64)) for value in values])


def compiled(law: Controller) -> Compiled:
    """The C version of a bound law. A class that is derived from a law doesn't inherit it.

    Raises:
        NotCompiledError: it has none, or none that does what its options ask for.
    """
    where = vars(type(law)).get("c_version", "")
    if not where:
        raise NotCompiledError("it has no C version")
    if extension is None:
        raise NotCompiledError(_missing)
    module, _, name = where.partition(":")
    made: Compiled = getattr(importlib.import_module(module), name)(law)
    return made


class RetryBackoff:
    """When C is tried again after a cycle that was Python's: what is out of the ordinary often lasts.

    After 1, 3, 7 and then always 15 cycles, until C has computed one. So the tries cost little.
    """

    MOST: Final = 15

    def __init__(self) -> None:
        self._left = self._pause = 0

    def over(self) -> bool:
        """Whether C is to be tried in this cycle."""
        if self._left > 0:
            self._left -= 1
            return False
        return True

    def tried(self, done: bool) -> None:
        """Whether C has computed this cycle."""
        self._pause = 0 if done else min(2 * self._pause + 1, self.MOST)
        self._left = self._pause

    def forget(self) -> None:
        """Begins anew."""
        self._left = self._pause = 0


class Compiled(ABC):
    """A bound law whose ordinary cycles are computed in C.

    While `inside`, the law's state is in the array `state`; else it is in the law's own attributes.
    """

    def __init__(self, law: Controller) -> None:
        self.law = law
        self.inside = False
        self.rare = 0  # cycles that Python has computed
        self._backoff = RetryBackoff()
        self._step = self._bind()

    def reset(self) -> None:
        """As the law's own."""
        self.leave()  # what a reset keeps: counts, for one
        self._backoff.forget()
        self.law.reset()

    def update(self, dt: float) -> None:
        """As the law's own."""
        if self.inside or self._backoff.over():
            if not self.inside:
                self._enter()
                self.inside = True
            done = self._step(dt) >= 0
            self._backoff.tried(done)
            if done:
                return
            self.leave()
        self.rare += 1
        self.law.update(dt)

    def leave(self) -> None:
        """Gives the law its state back: before it computes a cycle, and before it is asked for its figures."""
        if self.inside:
            self._leave()
            self.inside = False

    @abstractmethod
    def _bind(self) -> Step:
        """Binds the C function. Raises NotCompiledError: it doesn't do what the law's options ask for."""

    def _enter(self) -> None:
        """Takes the state from the law."""

    def _leave(self) -> None:
        """Gives the state to the law."""
