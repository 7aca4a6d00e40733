"""Settings for every test: hypothesis without deadlines, as the machine may be slow at any instant; short paths."""

import shutil
import signal
import tempfile

import pytest
from hypothesis import settings

LONGEST = 16  # bytes of the folder that holds all others: with a test's own below it, a Unix socket's 107 bytes do

# A shell starts what runs in its background with SIGINT ignored, and every child inherits that: a test that sends it to
# a process of its own would wait for good.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("srl", deadline=None, derandomize=True)
settings.load_profile("srl")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Gives `tmp_path` a short base of this run's own: runs hold Unix sockets, and pytest's own base is too long.

    It goes with the run; what a failed test left can be seen where the caller gives a `--basetemp`. A worker of xdist
    is told a folder below it by the run that started it.
    """
    if config.option.basetemp is None:
        root = next(folder for folder in (tempfile.gettempdir(), "/tmp") if len(folder) <= LONGEST)
        config.option.basetemp = tempfile.mkdtemp(prefix="srl-", dir=root)
        config.add_cleanup(lambda: shutil.rmtree(config.option.basetemp, ignore_errors=True))
