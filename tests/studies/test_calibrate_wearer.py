"""The simulated wearer does the whole calibration, and it is the one that comes with the profile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT

from runtime.control.ikns.record import read, write
from studies.ikns.calibrate_wearer import calibrated


@pytest.mark.slow
def test_the_file_of_the_profile_is_its_wearer_s(tmp_path: Path) -> None:
    made = calibrated((ROOT / "profiles/ikns-finger.yaml").read_text(), ("swivel",))
    write(tmp_path / "made.json", made)
    kept, again = (
        read(path).calibration() for path in (ROOT / "profiles/ikns-finger.calibration.json", tmp_path / "made.json")
    )
    assert again.sites == pytest.approx(kept.sites, abs=0.005)
    assert again.directions == pytest.approx(kept.directions, abs=0.05)
    assert np.rad2deg(kept.upper - kept.lower).min() > 90.0
    assert kept.explained.min() > 0.95
