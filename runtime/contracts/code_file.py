"""Laws and devices whose class is in a file beside the profile: `use: ./my_law.py:Follow`.

The file is read with the profile and kept with the run, as a calibration is, so a replay runs the text that was
recorded. It stands alone: it imports what is installed, no file beside it.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
import traceback
import types
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts import extras
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.errors import OptionError, ProfileError, nearest
from srl.runtime.contracts.files import Files, KeptFile, Typed
from srl.runtime.contracts.world import Fake

_BASES: Final[dict[str, tuple[type, type, str]]] = {
    "controllers": (Controller, ControllerConfig, "Controller"),
    "drivers": (Driver, DeviceConfig, "Sensor or Driver"),
}
PATTERN: Final = r"\.py:[A-Za-z][A-Za-z0-9_]*$"
"""What the name of a class in a file has, as a regular expression."""
_NAME: Final = re.compile("[A-Za-z][A-Za-z0-9_]*")
_EXAMPLE: Final = "Write FILE.py:CLASS, as in ./my_law.py:Follow"
MEND: Final = "Mend the file there; docs/own-law.md shows one"
_MODULE: Final = "srl_code_"
_OTHERWISE: Final = "Name an existing file, from the profile's folder on"


class CodeError(ProfileError):
    """The code in a file that a profile names can't be used, or fails."""


def is_file(name: str) -> bool:
    """Whether the name of a law or driver is that of a class in a file, not a registered one."""
    return ".py:" in name or name.endswith(".py")


def default_name(name: str) -> str:
    """What a law is called that has no name of its own: its class, as `lever-to-joint` for LeverToJoint."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name.rpartition(":")[2])
    return words.lower().strip("_")


def kept(name: str, files: Files, place: str) -> KeptFile:
    """The file that a name means, as it was when the profile was read.

    Raises:
        ProfileError: there is none that can be kept.
    """
    path = name.rpartition(":")[0]
    try:
        return files.keep(Typed(path) if isinstance(name, Typed) else path, _OTHERWISE)
    except OptionError as error:
        raise ProfileError(place, error.problem, error.remedy) from None


def load(group: str, name: str, files: Files, place: str) -> Any:
    """The class that a profile names as `FILE.py:CLASS`. Runs the file's code.

    Args:
        group: "controllers", "drivers"; or "fakes": that of a driver, whose class has `real` for it.
        name: as the profile writes it.
        files: the profile's.
        place: its key path, for errors.
    Raises:
        ProfileError: the name is none, there is no such file, or code isn't run here.
        CodeError: the code fails, or the class isn't one of the group.
    """
    path, _, wanted = name.rpartition(":")
    if not path:
        raise ProfileError(place, f"'{name}' doesn't say which class of the file it means", _EXAMPLE)
    if not _NAME.fullmatch(wanted):
        raise ProfileError(place, f"'{wanted}' is no class's name", _EXAMPLE)
    if not files.run_code:
        problem = f"the code of {path} isn't run: code in files was turned off here"
        remedy = "Turn it on with --run-code (of a service: in SRL_OPTIONS), or install the code as a package"
        raise ProfileError(place, problem, remedy)
    module = _module(path, kept(name, files, place), place)
    found = _checked(module, path, wanted, place, *_BASES["drivers" if group == "fakes" else group])
    return _fake(module, path, found, place) if group == "fakes" else found


def is_of_file(cls: object) -> bool:
    """Whether a class was loaded from such a file."""
    return getattr(cls, "__module__", "").startswith(_MODULE)


def fault(error: BaseException) -> CodeError | None:
    """What an error says if it came out of the code of such a file: its file and line; None if it didn't."""
    frames = [
        (frame.f_globals["__srl_path__"], line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if "__srl_path__" in frame.f_globals
    ]
    if not frames:
        return None
    path, line = frames[-1]
    return CodeError(f"{path} line {line}", f"{type(error).__name__}: {error}".rstrip(": "), MEND)


def _module(path: str, file: KeptFile, place: str) -> types.ModuleType:
    """The file's module; the same one for the same file with the same content."""
    digest = hashlib.sha256(str(file.path).encode() + b"\0" + file.content).hexdigest()
    name = f"{_MODULE}{Path(path).stem}_{digest[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    try:
        # Not by a coding that it declares: what a person reads as a comment might be none.
        text = file.content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CodeError(place, f"{path} isn't UTF-8 text", "Name a file of Python, saved as UTF-8") from None
    module = types.ModuleType(name)
    module.__file__ = str(file.path)
    module.__dict__["__srl_path__"] = path
    sys.modules[name] = module  # dataclasses and pydantic look a class's module up
    try:
        exec(compile(text, str(file.path), "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise _failed(error, path, file, place) from error
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _failed(error: BaseException, path: str, file: KeptFile, place: str) -> CodeError:
    """The error of a file that can't be imported."""
    if isinstance(error, SyntaxError) and error.filename in (str(file.path), None):
        line = f" line {error.lineno}" if error.lineno else ""
        return CodeError(place, f"{path}{line}: this isn't Python: {error.msg}", MEND)
    found = fault(error)
    at, problem = (found.place, found.problem) if found is not None else (path, f"{type(error).__name__}: {error}")
    if not isinstance(error, ImportError):
        return CodeError(place, f"{at}: {problem}", MEND)
    missing = (error.name or "").partition(".")[0]
    remedy = extras.import_remedy(error)
    if missing and any((file.path.parent / each).exists() for each in (missing, f"{missing}.py")):
        remedy = "The file must stand alone: what has several files is a package (docs/extending.md)"
    return CodeError(place, f"{at}: {problem}", remedy)


def _checked(
    module: types.ModuleType, path: str, wanted: str, place: str, base: type, config: type, words: str
) -> type:
    """The class, if it is one of its group. Raises CodeError."""
    cls = vars(module).get(wanted)
    own = [name for name, each in _classes(module) if issubclass(each, base) and each.__module__ == module.__name__]
    if not isinstance(cls, type):
        problem = f"{path} has no class '{wanted}'" if cls is None else f"'{wanted}' of {path} isn't a class"
        raise CodeError(place, problem, nearest(wanted, own))
    if not issubclass(cls, base) or issubclass(cls, Fake):
        what = "is a simulated device" if issubclass(cls, Fake) else f"isn't derived from {words}"
        raise CodeError(place, f"the class '{wanted}' of {path} {what}", f"Derive it from {words} of srl")
    if inspect.isabstract(cls):
        lacking = ", ".join(sorted(vars(cls)["__abstractmethods__"]))
        raise CodeError(place, f"the class '{wanted}' of {path} lacks {lacking}", "Write what is missing")
    options = getattr(cls, "Config", None)
    if not (isinstance(options, type) and issubclass(options, config)):
        problem = f"`Config` of the class '{wanted}' of {path} isn't derived from {config.__name__}"
        raise CodeError(place, problem, f"Derive it from {config.__name__} of srl")
    return cls


def _fake(module: types.ModuleType, path: str, real: type, place: str) -> type:
    """The class of the file that simulates a driver of it. Raises CodeError."""
    for _, each in _classes(module):
        if issubclass(each, Fake) and each.real is real and not inspect.isabstract(each):
            return each
    name = real.__name__
    remedy = f"Add a class to it that derives from Fake of srl.simulation, with real = {name}"
    raise CodeError(place, f"{path} has no class that simulates {name}", remedy)


def _classes(module: types.ModuleType) -> list[tuple[str, type]]:
    return [(name, each) for name, each in vars(module).items() if isinstance(each, type)]
