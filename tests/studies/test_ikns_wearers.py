"""The fifty simulated wearers, and the finger on the trigger."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from srl.runtime.models.models import BodyModel
from srl.sim.parts.body.wearer_config import Tracking, UpperBodyConfig
from srl.studies.ikns.curves import KINDS, SECONDS, curve
from srl.studies.ikns.trigger import TriggerFinger
from srl.studies.ikns.wearers import COUNT, Wearer, assumed, drawn, wearers

ALL = wearers()


def test_the_list_is_the_one_that_its_distributions_give() -> None:
    assert drawn() == ALL
    assert len(ALL) == COUNT == 50
    assert len({one.name for one in ALL}) == COUNT


@pytest.mark.parametrize("one", ALL[::7], ids=lambda one: one.name)
def test_a_wearer_is_a_valid_part_and_the_laws_body_is_another(one: Wearer) -> None:
    given = one.overrides("preview", assumed()["gain_error"])
    bodies = {name: BodyModel.model_validate(given[f"models.{name}"]) for name in ("body", "wearer")}
    options: dict[str, Any] = {
        key.removeprefix("sim.parts.wearer."): value for key, value in given.items() if key.startswith("sim.")
    }
    assert options.pop("model") == "wearer"
    config = UpperBodyConfig.model_validate({**options, "model": bodies["wearer"]})
    # Each property of the wearer is the part's, but for its size, which is the body's, and its finger.
    elsewhere = {"name", "stature", "upper_arm", "forearm", "palm", "hand", "force_noise"}
    for name in {field.name for field in fields(Wearer)} - elsewhere:
        owner = config.tracking if name in Tracking.model_fields else config
        assert getattr(owner, name) == getattr(one, name), name
    assert config.tracking.model == "preview"
    real, taped = bodies["wearer"].body, bodies["body"].body
    assert real.sizes["forearm"]["right"] == one.forearm != taped.sizes["forearm"]["right"]
    assert real.sizes["forearm"]["right"] == pytest.approx(taped.sizes["forearm"]["right"], abs=0.03)
    off = np.array([np.subtract(real.markers[label].at, taped.markers[label].at) for label in real.markers])
    assert 0.003 < np.sqrt(np.mean(off**2)) < 0.02


def finger(model: str = "preview", **changed: Any) -> TriggerFinger:
    """A finger without noise."""
    given = {"noise": 0.0, "force_noise": 0.0, "preload": 0.5, "seed": 3, **changed}
    return TriggerFinger(Tracking.model_validate({"model": model, "gain_error": 0.0}), **given)


def followed(who: TriggerFinger, name: str = "T2") -> np.ndarray[Any, Any]:
    """(3000,) what the trigger does at 100 Hz, 5 s before the curve and 25 s along it; the pointer is the trigger."""
    out = [0.0]
    for k in range(1, 3001):
        out.append(who.until(k / 100, lambda t: float(curve(name, t - 5.0)), out[-1]))
    return np.array(out[1:])


T = np.arange(1, 3001) / 100 - 5.0


@pytest.mark.parametrize("name", KINDS)
def test_a_finger_without_noise_is_the_curve_a_lag_later(name: str) -> None:
    value = followed(finger(), name)
    after = T > 1.0
    behind, ahead = (np.std(value[after] - curve(name, T[after] - lag)) for lag in (Tracking().lag, 0.0))
    assert behind < 0.4 * ahead


@pytest.mark.slow
def test_pursuit_is_further_behind_than_preview() -> None:
    error = {m: np.std(followed(finger(m))[T > 0] - curve("T2", T[T > 0])) for m in ("preview", "pursuit")}
    assert error["pursuit"] > 1.3 * error["preview"]


@pytest.mark.slow
def test_the_forces_noise_has_its_size_and_depends_on_the_seed_alone() -> None:
    noisy = [followed(finger(force_noise=0.03, seed=seed)) for seed in (5, 5, 6)]
    assert np.array_equal(noisy[0], noisy[1])
    assert not np.array_equal(noisy[0], noisy[2])
    still = (T > -3.0) & (T < 1.0)  # at 0.5: the force is that of the whole travel
    found = np.std(np.concatenate([one[still] for one in (noisy[0], noisy[2])]))
    assert 0.015 < found < 0.045
    assert np.all((noisy[0] >= 0.0) & (noisy[0] <= 1.0))
    assert len(T[T > 0.0]) == 100 * SECONDS
