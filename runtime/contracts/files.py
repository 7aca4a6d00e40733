"""Options that name a file: where it is looked for, and the content that a run keeps of it.

A relative path begins beside the profile's file. One that is typed at `--set` begins where srl runs.
"""

from __future__ import annotations

import base64
import binascii
import errno
import hashlib
import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final

from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from srl.runtime.contracts.errors import OptionError, RecordingError

LARGEST: Final = 1 << 20  # bytes of a file that is kept: each segment of a recording holds it


def read_regular(path: Path, most: int = -1) -> bytes:
    """The bytes of a regular file, `most` of them at most; -1: all.

    Raises:
        OSError: it can't be read, or is something else than a file.
    """
    with open_regular(path) as file:
        return file.read(most)


def open_regular(path: Path) -> BinaryIO:
    """A regular file, open for reading.

    A pipe would keep its reader waiting for ever, and opening a device may do something to it: they aren't opened.

    Raises:
        OSError: it can't be read, or is something else than a file.
    """
    _check_regular(os.stat(path).st_mode)
    # Between the two it may have become a pipe: then this doesn't wait for its other end.
    file = open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")  # noqa: SIM115  # who calls closes it
    try:
        _check_regular(os.fstat(file.fileno()).st_mode)
    except OSError:
        file.close()
        raise
    return file


def _check_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}
        raise OSError(errno.EINVAL, f"it is {kinds.get(stat.S_IFMT(mode), 'something else')}, not a file")


class Typed(str):
    """A text of the command line."""


@dataclass(frozen=True)
class KeptFile:
    """A file that an option names, as it was when the profile was read.

    Attributes:
        path: where it was looked for, for errors. It need not be there any more.
        content: its bytes.
    """

    path: Path
    content: bytes

    @property
    def sha256(self) -> str:
        """Hash of the content."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def text(self) -> str:
        """The content as text. Raises UnicodeDecodeError."""
        return self.content.decode("utf-8")

    @classmethod
    def read(cls, path: Path, otherwise: str = "Name an existing file") -> KeptFile:
        """Reads a file. Raises OptionError, with `otherwise` as the remedy for one that isn't there."""
        try:
            content = read_regular(path, LARGEST + 1)
        except FileNotFoundError:
            raise OptionError(f"there is no file {path}", otherwise) from None
        except OSError as error:
            raise OptionError(f"{path} can't be read: {error.strerror}", "Name a file that srl may read") from None
        if len(content) > LARGEST:
            raise OptionError(
                f"{path} has more than {LARGEST // 1024} KiB, which recordings would have to hold",
                "Name the right file",
            )
        return cls(path, content)


@dataclass
class Files:
    """The files of one profile.

    Attributes:
        folder: where relative paths begin.
        recorded: content by name, of a run that is repeated: nothing is read from the disk. None: read from the disk.
        kept: what the options had, by name.
        run_code: whether code in files that the profile names may be run (`srl.runtime.contracts.code_file`).
    """

    folder: Path = Path()
    recorded: Mapping[str, bytes] | None = None
    kept: dict[str, bytes] = field(default_factory=dict)
    run_code: bool = False

    def find(self, given: str | Path) -> Path:
        """The path that an option means. Raises OptionError."""
        try:
            path = Path(given).expanduser()
        except RuntimeError:
            raise OptionError(f"'{Path(given).parts[0]}' is no user's home here", "Write the path in full") from None
        return path.absolute() if isinstance(given, Typed) else (self.folder / path).absolute()

    def keep(self, given: str | Path, otherwise: str) -> KeptFile:
        """Reads the file that an option names, once. Raises OptionError."""
        # Names hold no folder of this machine: a run is repeated elsewhere.
        name = f"--set {given}" if isinstance(given, Typed) else str(given)
        path = self.find(given)
        if self.recorded is not None and name not in self.recorded:
            raise OptionError(f"the content of {name} wasn't kept with the run", "Record the run again")
        if name not in self.kept:
            read = self.recorded[name] if self.recorded is not None else KeptFile.read(path, otherwise).content
            self.kept[name] = read
        return KeptFile(path, self.kept[name])


@dataclass(frozen=True)
class FileOption:
    """Marks an option of the type `KeptFile`: the profile gives a path, the law or driver gets the content.

    What the option had is in every recording, and a replay uses that.

    Attributes:
        otherwise: the remedy if there is no such file.
    """

    otherwise: str = "Name an existing file"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._read)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return dict(_JSON)

    def _read(self, given: Any, info: ValidationInfo) -> KeptFile:
        if isinstance(given, KeptFile):
            return given
        return _files(info).keep(_path(given), self.otherwise)


def _files(info: ValidationInfo) -> Files:
    files: Files = (info.context or {}).get("files") or Files()
    return files


def _path(given: Any) -> str | Path:
    if not isinstance(given, str | Path) or not str(given):
        raise ValueError("must be the path of a file")
    return given


def _found(given: Any, info: ValidationInfo) -> Path:
    return _files(info).find(_path(given))


_JSON: Final = {"type": "string", "format": "path"}
ProfilePath = Annotated[Path, BeforeValidator(_found), WithJsonSchema(_JSON)]
"""An option that names a file too large to keep, such as a recording that a simulated person repeats."""


def encoded(kept: Mapping[str, bytes]) -> dict[str, dict[str, str]]:
    """Content by name as JSON types: its hash and its bytes in base 64."""
    return {
        name: {"sha256": hashlib.sha256(content).hexdigest(), "content": base64.b64encode(content).decode()}
        for name, content in kept.items()
    }


def decoded(value: Mapping[str, Mapping[str, str]], place: str) -> dict[str, bytes]:
    """Returns what `encoded` was given. Raises RecordingError: it is damaged."""
    found = {}
    for name, entry in value.items():
        try:
            content = base64.b64decode(entry["content"], validate=True)
        except (KeyError, binascii.Error):
            content = None
        if content is None or hashlib.sha256(content).hexdigest() != entry.get("sha256"):
            raise RecordingError(place, f"the content of {name} is damaged", "Use another recording")
        found[name] = content
    return found
