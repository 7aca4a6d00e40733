"""The router's configuration gives rights by role, and what a router would refuse is said before the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.run import refused

from srl.runtime.bus import certificates
from srl.runtime.bus.certificates import authority, sign
from srl.runtime.cli import main
from srl.runtime.profile.bus import BusConfig
from srl.runtime.ros2.router import configuration


@pytest.fixture
def lab(tmp_path: Path) -> dict[str, Any]:
    authority(tmp_path)
    sign(tmp_path, "robot", ["localhost"], 1)
    tls = {"ca": f"{tmp_path}/ca.pem", "certificate": f"{tmp_path}/robot.pem", "key": f"{tmp_path}/robot.key"}
    return {"ros2": {"router": "tls/localhost:7447", "commands": True}, "tls": tls, "roles": {"operator": ["anna"]}}


def rights(made: dict[str, Any], subject: str) -> dict[str, set[str]]:
    """What a subject may send, by kind of message: the keys."""
    access = made["access_control"]
    (policy,) = [each for each in access["policies"] if subject in each["subjects"]]
    found: dict[str, set[str]] = {}
    for rule in access["rules"]:
        if rule["id"] in policy["rules"] and "ingress" in rule["flows"]:
            for message in rule["messages"]:
                found.setdefault(message, set()).update(rule["key_exprs"])
    return found


def test_roles_have_the_rights_that_they_have_on_the_bus(lab: dict[str, Any]) -> None:
    lab["roles"] = {"observer": ["otto"], "operator": ["anna"], "engineer": ["eva"]}
    made = configuration(BusConfig.model_validate(lab), "worn-arm", ["client.position"])
    assert made["access_control"]["default_permission"] == "deny"
    names = {each["id"]: each["cert_common_names"] for each in made["access_control"]["subjects"]}
    assert names == {"limb": ["robot"], "observer": ["otto"], "operator": ["anna"], "engineer": ["eva"]}
    stop, setpoint = "0/worn_arm/stop/**", "0/worn_arm/client/position/commands/**"
    for role, commands, sets in (("observer", False, False), ("operator", True, False), ("engineer", True, True)):
        queries, puts = rights(made, role)["query"], rights(made, role).get("put", set())
        assert (stop in queries, setpoint in puts) == (commands, commands)
        assert ("0/worn_arm/*/set_parameters/**" in queries) is sets
        assert not [key for key in puts if "_action" in key], "feedback is the limb's to send"
        assert not {"0/**"} & (queries | puts), "nothing by wildcard"
        assert "declare_queryable" not in rights(made, role), "nobody answers in the limb's name"


@pytest.mark.parametrize(
    "change", [{"roles": {}}, {"ros2": {"router": "tcp/127.0.0.1:7447"}}, {"ros2": None}], ids=["roles", "tcp", "none"]
)
def test_without_tls_and_roles_there_is_no_such_configuration(lab: dict[str, Any], change: Any, tmp_path: Path) -> None:
    given = ["--set", f"bus={json.dumps(lab | change)}"]
    problem = refused("check", "servo-jog", "--sim", *given, "--router", str(tmp_path / "r.json5"))
    assert "bus.roles" in problem


def test_a_certificate_that_only_serves_is_refused_before_the_run(
    lab: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ["check", "servo-jog", "--sim", "--set", f"bus={json.dumps(lab)}"]
    assert main(given) == 0
    for file in ("robot.pem", "robot.key"):
        (tmp_path / file).unlink()
    server = certificates.ExtendedKeyUsageOID.SERVER_AUTH
    monkeypatch.setattr(certificates.ExtendedKeyUsageOID, "CLIENT_AUTH", server)  # as `srl keys` made them before
    sign(tmp_path, "robot", ["localhost"], 1)
    problem = refused(*given)
    assert "bus.tls.certificate" in problem
    assert "Make it anew: srl keys" in problem
