"""Rendered impedance: the fit on a motion known by formula, the claims, the picture, one trial of the real chain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.trial_rows import Here, row

from srl.runtime.profile import profile
from srl.studies.superman import rendered_trial
from srl.studies.superman.rendered import FREQUENCIES, STUDY, claims, draw, run, tasks
from srl.studies.superman.rendered_trial import TRIAL, trial

SHAKE = {"axis": "y", "locomotion": False, "published": False, "mass": 6.0, "damping": 40.0, "amplitude": 5.0}


@pytest.mark.parametrize(("gain", "late", "frequency"), [(1.0, 0.0, 2.0), (0.7, 0.02, 0.5), (2.0, 0.005, 10.0)])
def test_a_motion_of_known_gain_and_delay_is_measured(
    monkeypatch: pytest.MonkeyPatch, gain: float, late: float, frequency: float
) -> None:
    w = 2 * np.pi * frequency
    v = gain * SHAKE["amplitude"] / (SHAKE["damping"] + 1j * w * SHAKE["mass"])  # v(t) = Im(v e^jwt)

    class Known:
        cause = ""

        def __init__(self, *_: Any) -> None:
            pass

        def run(self) -> tuple[Any, Any]:
            t = np.arange(0.0, 4.0, 0.002)
            return t, np.imag(v / (1j * w) * np.exp(1j * w * (t - late))) + 0.3 + 0.01 * t

    monkeypatch.setattr(rendered_trial, "_Shaken", Known)
    found = trial("", SHAKE | {"frequency": frequency}, 0)
    assert found["gain"] == pytest.approx(gain, rel=1e-6)
    assert found["phase"] == pytest.approx(-np.rad2deg(w * late), abs=1e-4)
    assert found["rest"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_kairos_moves_as_the_law_says_but_for_its_delay() -> None:
    found = trial(profile.find("kairos-man")[1], SHAKE | {"frequency": 2.0}, 0)
    assert found["gain"] == pytest.approx(1.0, abs=0.1)
    assert -15 < float(found["phase"] or 0.0) < -4  # 2 Hz: 1 degree is 1.4 ms
    assert found["cause"] == ""


@pytest.mark.slow
def test_claims_are_of_our_law_and_of_what_a_person_does_on_purpose(tmp_path: Path) -> None:
    def off(gain: float, **where: Any) -> Any:
        chosen = [t for t in tasks(FREQUENCIES) if all(t.parameters[k] == v for k, v in where.items())]
        return [row(task, {"gain": gain, "phase": -10.0, "rest": 0.0, "cause": ""}) for task in chosen]

    rows = [*off(1.2, published=False), *off(9.0, published=True)]
    assert all(claim.holds for claim in claims(rows))
    rows += off(3.0, published=False, robot="moca", axis="rz", frequency=1.0)
    assert [claim.id for claim in claims(rows) if not claim.holds] == ["moca-rotation"]
    rows += off(3.0, published=False, robot="kairos", axis="y", frequency=10.0)
    assert [claim.id for claim in claims(rows) if not claim.holds] == ["moca-rotation"]
    assert not any(claim.holds for claim in claims([]))
    draw(rows, tmp_path / "bode.png")
    assert (tmp_path / "bode.png").stat().st_size > 10_000


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_study_runs(tmp_path: Path) -> None:
    result = run(tmp_path, True, Here({TRIAL: trial}))
    assert result.study == STUDY
    assert len(result.table) == 16
    assert all((tmp_path / file).exists() for file in result.files if file.endswith(".png"))
