"""Settings for every test: hypothesis without deadlines, as the machine may be slow at any instant; short paths."""

import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

OURS = pytest.StashKey[Path]()
LONGEST = 16  # bytes of the folder that holds all others: with a test's own below it, a Unix socket's 107 bytes do

settings.register_profile("srl", deadline=None, derandomize=True)
settings.load_profile("srl")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Gives `tmp_path` a short base of this run's own: runs hold Unix sockets, and pytest's own base is too long.

    A worker of xdist is told a folder below it by the run that started it.
    """
    if config.option.basetemp is None:
        root = next(folder for folder in (tempfile.gettempdir(), "/tmp") if len(folder) <= LONGEST)
        config.option.basetemp = tempfile.mkdtemp(prefix="srl-", dir=root)
        config.stash[OURS] = Path(config.option.basetemp)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Removes it; after a failure it stays, with what the failed tests left."""
    if exitstatus == 0 and (base := session.config.stash.get(OURS, None)) is not None:
        shutil.rmtree(base, ignore_errors=True)
