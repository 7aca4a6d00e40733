"""Start-up refuses to run another distribution's package under one of our names."""

from __future__ import annotations

import importlib.machinery
import importlib.util
from pathlib import Path

import pytest

from runtime.cli.run import check_names
from runtime.contracts.errors import HostError


def test_our_own_packages_are_found() -> None:
    check_names()


def test_a_foreign_package_of_our_name_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "__init__.py").touch()
    foreign = importlib.machinery.PathFinder.find_spec("sim", [str(tmp_path)])
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: foreign if name == "sim" else real(name, *rest)
    )
    with pytest.raises(HostError, match="package 'sim'"):
        check_names()
