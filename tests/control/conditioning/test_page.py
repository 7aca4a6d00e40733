"""docs/signal-laws.md: its tables are the options, and its profiles run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel
from ruamel.yaml import YAML

from srl.control.conditioning.element_wise import ElementWiseConfig
from srl.control.conditioning.linear import LinearConfig
from srl.control.conditioning.one_euro import OneEuroConfig
from srl.control.conditioning.switch import SwitchConfig
from srl.testing import Lab

PAGE = (Path(__file__).parents[3] / "docs" / "signal-laws.md").read_text()
PROFILE, ONE_EURO, SWITCH = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
MODELS: dict[str, type[BaseModel]] = {
    "of each": ElementWiseConfig, "of `linear`": LinearConfig, "of `one-euro`": OneEuroConfig,
    "of `switch`": SwitchConfig,
}  # fmt: skip


@pytest.mark.parametrize("of", MODELS)
def test_the_tables_have_every_option_with_its_default(of: str) -> None:
    (table,) = re.findall(rf"^\| option {of} \|.*\n\|.*\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
    shown = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", table, re.MULTILINE))
    shared = set() if of == "of each" else set(ElementWiseConfig.model_fields)
    defaults = {name: field.default for name, field in MODELS[of].model_fields.items() if name not in shared}
    assert shown.keys() == defaults.keys()
    for name, default in defaults.items():
        plain = list(default) if isinstance(default, tuple) else default
        text = {None: "none", "[]": "empty"}.get(None if plain is None else str(plain), str(plain))
        assert shown[name].strip("`").replace("'", "") == text.replace("'", ""), name


@pytest.mark.slow
def test_the_dial_moves_its_servo_within_the_range() -> None:
    with Lab(PROFILE) as run:
        run.until("active")
        run.run(6.0)
        finger, servo = run.history("glove.position"), run.history("finger.position_command.applied")
        assert np.ptp(finger) > 0.5
        assert 0.3 < np.ptp(servo) <= 0.6
        run.fault("glove", "nan")
        run.until("stopped", most=2.0)
        assert run.cause == "intent_loss"


@pytest.mark.slow
def test_a_button_hands_over_between_a_client_and_the_filtered_glove() -> None:
    tree = YAML(typ="safe").load(PROFILE)
    tree["controllers"] = YAML(typ="safe").load(f"{ONE_EURO}{SWITCH}")
    tree["devices"]["pad"] = {"driver": "gamepad"}
    tree["setpoints"] = {"client.target": {"shape": [1], "unit": "rad"}}
    tree["sim"]["devices"]["pad"] = {"buttons": {"a": [[3.0, 100.0]]}}
    with Lab(tree) as run:
        run.setpoint("client.target", [0.3])
        run.until("active")
        run.run(1.0)
        run.check("finger.position_command", near=0.0, within=1e-6)  # the client hasn't met it yet
        for target in (0.0, 0.3):
            run.setpoint("client.target", [target])
            run.run(0.5)
        run.check("finger.position_command", near=0.3, within=1e-6)
        run.run(12.0)
        assert run["source.chosen"] == 1
        run.check("finger.position_command", near=run["smooth.y"], within=1e-6)
        asked = run.history("finger.position_command").reshape(-1)
        assert np.abs(np.diff(asked[-1200:])).max() < 0.1  # it never jumped
