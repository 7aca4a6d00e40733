"""The run folder: nobody else may replace it, and only its owner reads what is in it."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.run_folder import RunFolder

OTHER = 12345  # a user's number


@pytest.fixture
def parent(tmp_path: Path) -> Path:
    (tmp_path / "parent").mkdir(mode=0o755)
    return tmp_path / "parent"


def test_a_folder_of_ours_is_taken_and_closed_to_others(parent: Path) -> None:
    folder = RunFolder(parent / "finger")
    folder.path.mkdir()
    folder.path.chmod(0o777)
    folder.claim()
    assert folder.path.stat().st_mode & 0o777 == 0o750
    assert folder.is_claimed()
    folder.release()
    assert not folder.is_claimed()


def test_who_looks_whether_it_is_claimed_keeps_nobody_from_claiming_it(tmp_path: Path) -> None:
    folder, other, ended = RunFolder(tmp_path / "finger"), RunFolder(tmp_path / "finger"), threading.Event()

    def look() -> None:
        while not ended.is_set():
            other.is_claimed()

    looking = threading.Thread(target=look)
    looking.start()
    try:
        for _ in range(300):
            folder.claim()
            folder.release()
    finally:
        ended.set()
        looking.join()


def test_the_folder_above_is_made_so_that_it_is_accepted_again(parent: Path) -> None:
    before = os.umask(0o002)
    try:
        RunFolder(parent / "srl" / "finger").claim()
        RunFolder(parent / "srl" / "other").claim()
    finally:
        os.umask(before)


@pytest.mark.parametrize("mode", [0o775, 0o757])
def test_a_parent_that_others_may_write_is_refused(parent: Path, mode: int) -> None:
    parent.chmod(mode)
    with pytest.raises(HostError, match="others may write this folder") as error:
        RunFolder(parent / "finger").claim()
    assert error.value.place == str(parent)
    parent.chmod(mode | 0o1000)  # with the sticky bit only the owner may replace it
    RunFolder(parent / "finger").claim()


@pytest.mark.parametrize("whose", ["parent", "finger"])
@pytest.mark.skipif(os.geteuid() != 0, reason="giving a folder away takes root")
def test_a_folder_of_another_user_is_refused(parent: Path, whose: str) -> None:
    folder = RunFolder(parent / "finger")
    folder.path.mkdir()
    given = parent if whose == "parent" else folder.path
    os.chown(given, OTHER, OTHER)
    with pytest.raises(HostError, match="belongs to another user") as error:
        folder.claim()
    assert error.value.place == str(given)


@pytest.mark.skipif(os.geteuid() != 0, reason="giving a link away takes root")
def test_another_users_link_on_the_way_is_refused(tmp_path: Path, parent: Path) -> None:
    (tmp_path / "link").symlink_to(parent)
    os.chown(tmp_path / "link", OTHER, OTHER, follow_symlinks=False)
    with pytest.raises(HostError, match="belongs to another user"):
        RunFolder(tmp_path / "link" / "finger").claim()


def test_a_path_that_any_socket_could_not_bear_is_refused_before_the_run(parent: Path) -> None:
    """The bus's, of a longer name than the loop's, would fail once the limb moves."""
    room = 107 - len(str(parent / "x" / "zenoh.sock"))
    RunFolder(parent / ("x" * (1 + room))).claim()
    with pytest.raises(HostError, match="too long for a Unix socket"):
        RunFolder(parent / ("x" * (2 + room))).claim()
