"""The calibration files that the tests of the law share."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.null_space_arm import calibrated

from srl.control.ikns.record import Record


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ikns") / "p07.json"
    calibrated(path)
    return path


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record]:
    path = tmp_path_factory.mktemp("ikns") / "two.json"
    return path, calibrated(path, "clavicle", 2)
