"""A device of somebody else's: the package that `srl new device` writes, to be imported."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from srl.commissioning.cli import new_device

NAME = "probe"


@pytest.fixture(scope="session")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """Its modules `protocol`, `driver`, `fake` and `twin`."""
    folder = tmp_path_factory.mktemp("probe")
    for path, text in new_device.package(NAME).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    sys.path.insert(0, str(folder))
    try:
        names = ("protocol", "driver", "fake", "twin")
        yield SimpleNamespace(**{name: importlib.import_module(f"srl_probe.{name}") for name in names})
    finally:
        sys.path.remove(str(folder))
        for module in [name for name in sys.modules if name.partition(".")[0] == "srl_probe"]:
            del sys.modules[module]
