"""Settings for every test: hypothesis without deadlines, as the machine may be slow at any instant; short paths."""

import gc
import os
import shutil
import signal
import tempfile

import pytest
from helpers.sampled import sampled, third
from hypothesis import settings

LONGEST = 16  # bytes of the folder that holds all others: with a test's own below it, a Unix socket's 107 bytes do

# A shell starts what runs in its background with SIGINT ignored, and every child inherits that: a test that sends it to
# a process of its own would wait for good.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Derandomised, the examples are the same in each run: more of them find nothing that was not found before. New ones are
# looked for by `make exhaustive`.
settings.register_profile("srl", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("exhaustive", deadline=None, max_examples=1000)
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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Takes the samples; and of the slow tests only a third, where `SRL_TEST_THIRD` says which."""
    _sample(items)
    asked = os.environ.get("SRL_TEST_THIRD", "")
    if not asked:
        return
    taken, left = [], []
    for item in items:
        file = item.path.relative_to(config.rootpath).as_posix()
        (left if item.get_closest_marker("slow") and third(file) != int(asked) else taken).append(item)
    items[:] = taken
    config.hook.pytest_deselected(items=left)


def _sample(items: list[pytest.Item]) -> None:
    """Of a test marked `sampled` CI runs a sample of its cases; the others are marked `slow` and `exhaustive`.

    `sampled()`: so few that each value of each parameter occurs; `sampled(n)`: n of them, evenly spaced. A case that is
    asked for alone is a sample of its own.
    """
    products: dict[str, list[pytest.Function]] = {}
    for item in items:
        if isinstance(item, pytest.Function) and item.get_closest_marker("sampled"):
            products.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in products.values():
        marker = cases[0].get_closest_marker("sampled")
        assert marker is not None
        values = [{name: id(value) for name, value in case.callspec.params.items()} for case in cases]
        taken = sampled(values, *marker.args)
        for i, case in enumerate(cases):
            if i not in taken:
                case.add_marker("slow")
                case.add_marker("exhaustive")


def pytest_collection_finish() -> None:
    """What was imported stays. Looking through it again and again takes a twentieth of the tests' time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)
