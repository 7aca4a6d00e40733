"""The profile's `models:`: entries by kind, options that name them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from srl.control.hand.hand_kinematics import HandKinematicsConfig
from srl.control.hand.object_mapping import ObjectMappingConfig
from srl.runtime.cli import main
from srl.runtime.models.human_hand import MODEL_LENGTH, hand_geometry
from srl.runtime.models.models import FingerModel, HandModel, context
from srl.runtime.models.point_series import PointSeries
from srl.runtime.profile import profile, wiring


def law(name: str, models: str, *overrides: str, **options: str) -> object:
    """The options of a law of sixth-finger with other `models:`, options and overrides."""
    text = profile.find("sixth-finger")[1]
    head, _, rest = text.partition("models:\n")
    while rest.startswith((" ", "#")):
        rest = rest.partition("\n")[2]
    for option, value in options.items():
        head = head.replace(f"    name: {name}\n", f"    name: {name}\n    {option}: {value}\n")
    text = f"{head}models:\n{models}{rest}" if models else head + rest
    graph = wiring.build(*profile.parse("finger.yaml", text, overrides))
    return next(one.controller.config for one in graph.laws if one.controller.name == name)


SHORT = "  finger: {kind: finger, rows: [[1.5707963, 0.02], [0, 0.03], [0, 0.03], [0, 0.02]]}\n"


def test_an_option_that_is_left_out_means_the_entry_of_the_kinds_name() -> None:
    config = law("mapping", SHORT)
    assert isinstance(config, ObjectMappingConfig)
    assert [finger.model.rows[3] for finger in config.fingers] == [(0.0, 0.02)]
    hand = law("hand", "  hand: {kind: hand, side: left, length: 0.2}\n")
    assert isinstance(hand, HandKinematicsConfig)
    assert (hand.hand.side, hand.hand.length) == ("left", 0.2)


def test_without_an_entry_it_is_the_standard_one() -> None:
    config, hand = law("mapping", ""), law("hand", "")
    assert isinstance(config, ObjectMappingConfig)
    assert isinstance(hand, HandKinematicsConfig)
    assert [(f.name, f.model) for f in config.fingers] == [("finger", FingerModel())]
    assert hand.hand == HandModel()


def test_options_name_an_entry() -> None:
    worn = "frames.short={parent: hand}"
    config = law("mapping", SHORT.replace("finger:", "short:", 1), worn, fingers="[short]")
    assert isinstance(config, ObjectMappingConfig)
    (finger,) = config.fingers
    assert finger.name == "short"
    assert finger.model.rows[1] == (0.0, 0.03)
    config = law("mapping", SHORT.replace("finger:", "short:", 1), fingers="[{model: short, name: finger}]")
    assert isinstance(config, ObjectMappingConfig)
    assert config.fingers[0].name == "finger"


WRONG = {
    "no such entry": ("", "    fingers: [thum]\n", ["controllers.1.fingers.0.model", "no finger called 'thum'"]),
    "nearest entry": (
        "  short: {kind: finger}\n",
        "    fingers: [shrt]\n",
        ["fingers.0.model", "no finger called 'shrt'", "Did you mean 'short'?"],
    ),
    "entry of another kind": (
        "  mine: {kind: hand}\n",
        "    fingers: [mine]\n",
        ["fingers.0.model", "'mine' is a hand, not a finger"],
    ),
    "no name": ("", "    fingers: [{model: 3}]\n", ["fingers.0.model", "name of a finger"]),
    "where rows stood": ("", "    fingers: [{rows: [[0, 1]]}]\n", ["fingers.0", "'rows' is gone", "models:"]),
    "no such kind": ("  mine: {kind: fingr}\n", "", ["line", "models.mine", "'fingr'", "Did you mean 'finger'?"]),
    "no kind": ("  mine: {side: left}\n", "", ["models.mine", "'kind' is missing", "finger, hand, body"]),
    "misspelt key": ("  mine: {kind: finger, row: []}\n", "", ["models.mine", "no key 'row'", "Did you mean 'rows'?"]),
    "misspelt name": ("  Mine: {kind: finger}\n", "", ["models", "'Mine' isn't a valid name"]),
    "limits that are crossed": (
        "  mine: {kind: finger, lower: [2, 2, 2, 2]}\n",
        "",
        ["models.mine", "every lower limit must be below"],
    ),
    "too long a hand": ("  mine: {kind: hand, length: 1.9}\n", "", ["models.mine.length", "1.9"]),
    "a length that a body hasn't": (
        "  mine: {kind: body, lengths: {uper_arm: 0.3}}\n",
        "",
        ["models.mine", "no length 'uper_arm'", "Did you mean 'upper_arm'?"],
    ),
    "a marker on nothing": (
        "  mine: {kind: body, markers: {X: {segment: right_hnd, at: [0, 0, 0]}}}\n",
        "",
        ["models.mine", "no segment 'right_hnd'", "Did you mean 'right_hand'?"],
    ),
    "the hand where it stood": (None, "    hand_length: 0.18\n", ["controllers.0", "'hand_length' is gone", "models:"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_models_are_refused(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    models, option, words = WRONG[case]
    text = profile.find("sixth-finger")[1]
    name = "hand" if models is None else "mapping"
    text = text.replace(f"    name: {name}\n", f"    name: {name}\n{option}")
    if models:
        text = text.replace("models:\n", f"models:\n{models}")
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    assert main(["check", str(path)]) == 2
    output = capsys.readouterr().err
    assert output.startswith("srl check: ")
    assert len(output.strip().splitlines()) == 1
    for word in words:
        assert word in output, f"'{word}' isn't in: {output}"


@pytest.mark.parametrize(
    "options",
    [
        {"lower": (-1.0,)},
        {"lower": (2.0, 2.0, 2.0, 2.0)},
        {"upper": (np.inf, 1.0, 1.0, 1.0)},
        {"rows": ()},
        {"joints": ("a", "b", "c")},
        {"joints": ("a", "b", "c", "a")},
        {"reach": 1.0},
    ],
)
def test_wrong_fingers_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        FingerModel(**options)


def test_the_standard_name_is_taken_only_by_its_kind() -> None:
    with pytest.raises(ValidationError, match="is a finger, not a hand"):
        HandKinematicsConfig.model_validate({}, context=context({"hand": FingerModel()}))


def test_a_left_hand_is_the_mirrored_right_one_with_frames_that_a_body_can_have() -> None:
    q = np.random.default_rng(2).uniform(-1.0, 1.5, 20)
    bases, rows = HandModel(side="left", length=1.1 * MODEL_LENGTH).geometry()
    np.testing.assert_allclose(np.linalg.det(bases[:, :3, :3]), 1.0)
    expected = PointSeries(*hand_geometry(1.1 * MODEL_LENGTH)).at(q) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(PointSeries(bases, rows).at(q), expected, atol=1e-15)
