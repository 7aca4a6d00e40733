"""The laws as published: each option of ours has a value that switches it off, and it is used."""

from __future__ import annotations

from importlib.resources import files

import pytest

from srl.control.cobot.admittance import AdmittanceConfig
from srl.control.cobot.kairos_clik import KairosClikConfig
from srl.control.cobot.moca_impedance import MocaImpedanceConfig
from srl.runtime.contracts.controller import ControllerConfig
from srl.studies.simulated import controllers
from srl.studies.superman.as_published import OFF, WATCH, as_published

# Options with a counterpart in the paper or in the robot, by law; how additions work is part of the addition.
PAPER = {
    AdmittanceConfig: {
        *("mass", "damping", "calibration", "dead_band"),
        *("brake", "force_age"),  # of the tank
    },
    MocaImpedanceConfig: {
        *("robot", "stiffness", "damping_ratio", "manipulation", "locomotion", "virtual_mass", "base_damping"),
        *("gravity", "coriolis", "payload", "payload_time"),  # what the robot itself doesn't compensate
    },
    KairosClikConfig: {"robot", "gain", "tracking", "damping", "manipulability", "manipulation", "locomotion"},
}
USES = {"admittance": AdmittanceConfig, "moca-impedance": MocaImpedanceConfig, "kairos-clik": KairosClikConfig}


@pytest.mark.parametrize("use", OFF)
def test_every_option_is_the_papers_or_can_be_switched_off(use: str) -> None:
    config: type[ControllerConfig] = USES[use]
    ours = set(config.model_fields) - set(ControllerConfig.model_fields)
    assert ours == PAPER[config] | OFF[use].keys(), "is a new option the paper's, or an addition that OFF switches off?"
    config(**OFF[use])


@pytest.mark.parametrize("name", ["moca-man", "kairos-man"])
def test_the_profiles_laws_lose_their_additions_and_nothing_else(name: str) -> None:
    before = controllers((files("srl.profiles") / f"{name}.yaml").read_text(), "guide")
    kept_laws = [entry for entry in before if entry["use"] != WATCH]
    for old, new in zip(kept_laws, as_published(before), strict=True):
        off = OFF.get(old["use"], {})
        assert off.items() <= new.items()
        kept = {key: value for key, value in old.items() if key not in off and key != "in"}
        assert {key: value for key, value in new.items() if key not in off and key != "in"} == kept
        assert not {"flange_wrench", "hand", "outside"} & set(new.get("in", {}))
