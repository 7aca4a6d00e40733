"""Files that options name: what isn't a file is refused at once, whatever opens it."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from srl.runtime.contracts.errors import OptionError, ProfileError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.profile import profile


def _made(path: Path, kind: str) -> Path:
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a socket":
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(str(path))
    elif kind == "a device":
        path.symlink_to("/dev/null")
    return path


@pytest.mark.parametrize("kind", ["a pipe", "a socket", "a device"])
def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path, kind: str) -> None:
    path = _made(tmp_path / "a.yaml", kind)
    with pytest.raises(OptionError, match=f"{path} can't be read: it is {kind}, not a file"):
        KeptFile.read(path)
    with pytest.raises(ProfileError, match=f"it is {kind}, not a file"):
        profile.load(str(path))


def test_files_links_and_folders_are_as_before(tmp_path: Path) -> None:
    file, link = tmp_path / "a", tmp_path / "b"
    file.write_bytes(b"12\r\n")
    link.symlink_to(file)
    assert KeptFile.read(link).content == b"12\r\n"
    with pytest.raises(OptionError, match="Is a directory"):
        KeptFile.read(tmp_path)
    with pytest.raises(OptionError, match="there is no file"):
        KeptFile.read(tmp_path / "c")
