"""Every profile that is shipped: its wiring holds, on the real devices and in simulation."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.run import call

from runtime.profile import profile, wiring

PROFILES = sorted(path.stem for path in (Path(__file__).parents[2] / "profiles").glob("*.yaml"))


@pytest.mark.parametrize("name", PROFILES)
def test_its_wiring_holds(name: str) -> None:
    checked, source = profile.load(name)
    real = wiring.build(checked, source)
    assert not real.simulated
    simulated = wiring.build(checked, source, [])
    assert simulated.world is not None
    assert set(simulated.simulated) == set(checked.devices)
    simulated.world.close()


@pytest.mark.parametrize("name", PROFILES)
def test_srl_check_accepts_it(name: str, tmp_path: Path) -> None:
    assert f"{name}" in call(tmp_path, "check", name).stdout
