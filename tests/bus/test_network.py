"""What the bus process listens on: its Unix socket, and the network by mutual TLS only, each role with its rights."""

from __future__ import annotations

import datetime
import json
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from cryptography import x509
from helpers.bus import Instance, sockets, spawn
from helpers.run import refused
from helpers.wait import until

from srl.runtime.bus import certificates, session
from srl.runtime.bus.certificates import authority, sign
from srl.runtime.bus.client import connect
from srl.runtime.cli import main
from srl.runtime.contracts.errors import HostError, NoAnswerError, RequestError
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import Keys

ROLES = {"observer": ["otto"], "operator": ["anna"], "engineer": ["eva"]}


class Lab:
    """An instance that listens for the network, and certificates of its authority and of another one."""

    def __init__(self, folder: Path) -> None:
        for name in ("lab", "elsewhere"):
            (folder / name).mkdir()
            authority(folder / name)
            for person in ("otto", "anna", "eva", "nobody"):
                sign(folder / name, person, [], 1)
        sign(folder / "lab", "robot", ["localhost", "127.0.0.1"], 1)
        self.folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.endpoint = f"tls/localhost:{self.port}"
        tls = self.tls("robot").model_dump()
        self.instance = Instance(folder / "one", listen=[f"tls/127.0.0.1:{self.port}"], tls=tls, roles=ROLES)

    def tls(self, name: str, of: str = "lab") -> TlsConfig:
        """The certificate of one person, who trusts this lab."""
        certificate, key = (str(self.folder / of / f"{name}.{ending}") for ending in ("pem", "key"))
        return TlsConfig(ca=str(self.folder / "lab" / "ca.pem"), certificate=certificate, key=key)

    def raw(self, name: str, key: str) -> list[dict[str, Any]]:
        """What a client that isn't ours gets for a query."""
        opened = session.join(self.endpoint, self.tls(name))
        try:
            found = [a.ok for a in opened.get(key, timeout=1.0)]
            return [json.loads(ok.payload.to_bytes()) for ok in found if ok is not None]
        finally:
            opened.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    found = Lab(tmp_path_factory.mktemp("lab"))
    yield found
    found.instance.close()


def test_an_engineer_may_do_all(lab: Lab) -> None:
    with connect(lab.endpoint, lab.tls("eva")) as client:
        assert (client.instance, client.role) == ("one", "engineer")
        client.command("stop")
        assert client.command("reset")["ok"]
        name = next(iter(client.parameters()))
        value = client.get_param(name)
        client.set_param(name, (value["lower"] + value["upper"]) / 2)


def test_an_operator_may_command_but_sets_no_parameter(lab: Lab) -> None:
    with connect(lab.endpoint, lab.tls("anna")) as client:
        assert client.role == "operator"
        client.command("stop")
        assert client.command("reset")["ok"]
        name, value = next(iter(client.parameters().items()))
        with pytest.raises(RequestError, match="role is operator, who may set no parameter"):
            client.set_param(name, value["value"])


def test_an_observer_reads_and_its_commands_are_refused_and_recorded(lab: Lab) -> None:
    with connect(lab.endpoint, lab.tls("otto")) as client:
        assert client.role == "observer"
        assert client.status()["state"]
        assert client.meta()
        before = lab.instance.client.status()["refused"]
        for command in ("stop", "reset", "start"):
            with pytest.raises(RequestError, match="role is observer, who may only read"):
                client.command(command)
        with pytest.raises(RequestError, match="may only read"):
            client.set_param(next(iter(client.parameters())), 1.0)
    until(lambda: lab.instance.client.status()["refused"] > before, what="the refusal in the rows")


@pytest.mark.parametrize("person", ["otto", "anna", "eva", "nobody"])
@pytest.mark.parametrize("of", [None, "observer", "operator", "engineer"])
def test_nobody_asks_as_another(lab: Lab, person: str, of: str | None) -> None:
    """A client that isn't ours takes the keys of another role, or of this machine: nothing answers."""
    roles = {name: role for role, names in ROLES.items() for name in names}
    keys = Keys("one", of)
    answered = lab.raw(person, keys.command("stop"))
    mine = of is not None and roles.get(person) == of
    assert [answer["ok"] for answer in answered] == ([of != "observer"] if mine else [])
    if answered and answered[0]["ok"]:
        lab.instance.client.command("reset")


def test_who_isnt_named_sees_nothing(lab: Lab) -> None:
    with pytest.raises(NoAnswerError, match=r"no srl instance is alive there.*name has no role.*`bus.roles`[^?]*\.$"):
        connect(lab.endpoint, lab.tls("nobody"), timeout=0.5)
    assert lab.raw("nobody", "srl/one/state/**") == []
    heard: list[str] = []
    with session.join(lab.endpoint, lab.tls("nobody")) as nobody, session.join(lab.endpoint, lab.tls("otto")) as otto:
        nobody.declare_subscriber("**", lambda sample: heard.append(str(sample.key_expr)))
        nobody.liveliness().declare_subscriber("**", lambda sample: heard.append(str(sample.key_expr)), history=True)
        assert list(nobody.liveliness().get("srl/*/alive", timeout=1.0)) == []
        for _ in range(3):  # whole statuses, which the others hear
            _hear(otto, "srl/one/status", {"srl/one/status"})
    assert heard == []


def _hear(opened: zenoh.Session, key: str, wanted: set[str]) -> set[str]:
    """What a client hears until it has heard what is wanted."""
    heard: set[str] = set()
    subscriber = opened.declare_subscriber(key, lambda sample: heard.add(str(sample.key_expr)))
    until(lambda: wanted <= heard)
    subscriber.undeclare()
    return heard


@pytest.mark.parametrize("person", ["otto", "anna", "eva"])
@pytest.mark.parametrize("key", ["**", "srl/**", "srl/one/**"])
def test_every_role_sees_the_token_and_hears_all_that_is_published(lab: Lab, person: str, key: str) -> None:
    tokens: list[str] = []
    with session.join(lab.endpoint, lab.tls(person)) as opened:
        for which in (key, "srl/*/alive"):
            found = opened.liveliness().get(which, timeout=5)
            assert [str(answer.ok.key_expr) for answer in found if answer.ok] == ["srl/one/alive"]
        opened.liveliness().declare_subscriber(key, lambda s: tokens.append(str(s.key_expr)), history=True)
        until(lambda: tokens == ["srl/one/alive"])
        _hear(opened, key, {"srl/one/status", "srl/one/state/glove/position", "srl/one/state/hand/tips"})


def test_nobody_hears_another_clients_setpoint(lab: Lab) -> None:
    with connect(lab.endpoint, lab.tls("anna")) as client, session.join(lab.endpoint, lab.tls("otto")) as otto:
        heard: list[str] = []
        otto.declare_subscriber("**", lambda sample: heard.append(str(sample.key_expr)))
        client.setpoint("client.force", [1, 2, 3], answer=True)
        client.setpoint("client.force", [4, 5, 6])
        until(lambda: lab.instance.run.setpoints[-1][1].tolist() == [4, 5, 6])
        heard.clear()
        until(lambda: "srl/one/status" in heard)
    assert not [key for key in heard if "setpoint" in key]


@pytest.mark.parametrize("person", ["otto", "anna", "eva"])
@pytest.mark.parametrize("key", ["**", "srl/**", "srl/one/**", "srl/one/as/*/cmd/stop", "srl/*/as/engineer/cmd/stop"])
def test_no_role_asks_by_a_wildcard_beyond_its_own_keys(lab: Lab, person: str, key: str) -> None:
    """Nothing answers, as the page says: what would include another role's keys is none of this role's."""
    taken = len(lab.instance.run.taken)
    assert lab.raw(person, key) == []
    assert len(lab.instance.run.taken) == taken


@pytest.mark.parametrize(("person", "role"), [("otto", "observer"), ("anna", "operator"), ("eva", "engineer")])
def test_a_role_reads_by_the_wildcards_of_the_page(lab: Lab, person: str, role: str) -> None:
    with session.join(lab.endpoint, lab.tls(person)) as opened:
        for key in ("srl/one/state/**", "srl/one/status", "srl/one/events", f"srl/one/as/{role}/param/**"):
            answers = [answer.ok for answer in opened.get(key, timeout=5)]
            assert answers, key
            assert None not in answers, key


def test_who_asks_without_the_right_is_told_and_so_is_one_whose_bus_has_died(lab: Lab) -> None:
    with connect(lab.endpoint, lab.tls("otto")) as client:
        with pytest.raises(RequestError, match="may only read"):
            client.setpoint("client.force", [1, 2, 3])
        client.keys = Keys("one", "engineer")  # as a client that takes another's
        with pytest.raises(NoAnswerError, match=r"instance 'one' \(srl/one/as/engineer/cmd/stop\): nobody answered"):
            client.command("stop")
    own = lab.instance
    with connect(lab.endpoint, lab.tls("anna")) as client:
        client.setpoint("client.force", [1, 2, 3])
        own.process.kill()
        own.process.wait()
        until(lambda: not client._presence.there)
        for ask in (lambda: client.setpoint("client.force", [1, 2, 3]), lambda: client.command("stop"), client.events):
            with pytest.raises(NoAnswerError, match="`srl stop one`"):
                ask()
        assert own.process.stderr is not None
        own.process.stderr.close()
        own.process = spawn(own.run_folder, stderr=subprocess.PIPE)
        until(lambda: client._presence.there)
        assert client.command("stop")["ok"]
        assert client.command("reset")["ok"]
    until(lambda: own.client._presence.there)  # for the tests after this one


def test_no_certificate_or_that_of_another_authority_is_no_connection(lab: Lab) -> None:
    for certificate, endpoint in (
        (lab.tls("eva", "elsewhere"), lab.endpoint),
        (None, f"tcp/127.0.0.1:{lab.port}"),
        (None, lab.endpoint),
    ):
        with pytest.raises(RequestError):
            connect(endpoint, certificate, timeout=0.5)
    assert sockets(lab.instance.process.pid) == {
        f"unix {lab.instance.run_folder.bus_socket}",
        f"tcp 0100007F:{lab.port:04X}",
    }


def test_a_client_of_this_machine_takes_no_role(lab: Lab) -> None:
    opened = session.join(f"unixsock-stream/{lab.instance.run_folder.bus_socket}")
    try:
        assert [a.ok for a in opened.get(Keys("one", "engineer").command("stop"), timeout=1.0)] == []
    finally:
        opened.close()


def test_what_is_far_too_long_isnt_taken_in_and_the_rest_is(lab: Lab) -> None:
    """Of a role that may only read it isn't even parsed. 40 MB of JSON kept the bus from everybody else."""
    opened = session.join(lab.endpoint, lab.tls("otto"))
    try:
        key = Keys("one", "observer").parameter("object-mapping.pull")
        assert [a.ok for a in opened.get(key, payload=b" " * 2 * session.LONGEST_MESSAGE, timeout=0.3) if a.ok] == []
        for payload in (b"2.0", b"[" * 10_000, b"\x00\x01\x00\x00"):
            (answer,) = opened.get(key, payload=payload, timeout=2.0)
            assert answer.ok is not None
            assert b"may only read" in answer.ok.payload.to_bytes()
    finally:
        opened.close()


@pytest.mark.slow
def test_a_connection_ends_with_its_certificate(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    started = certificates._begun

    def short(*given: Any) -> x509.CertificateBuilder:
        made = started(*given)
        made._not_valid_after = None
        return made.not_valid_after(datetime.datetime.now(datetime.UTC) + datetime.timedelta(seconds=3))

    (lab.folder / "lab" / "eva.pem").rename(lab.folder / "lab" / "eva-before.pem")
    (lab.folder / "lab" / "eva.key").rename(lab.folder / "lab" / "eva-before.key")
    monkeypatch.setattr(certificates, "_begun", short)
    sign(lab.folder / "lab", "eva", [], 1)

    def refused() -> bool:
        try:
            client.command("stop")
        except RequestError as error:
            return "nobody answered" in str(error)
        return False

    with connect(lab.endpoint, lab.tls("eva")) as client:
        assert not refused()
        until(refused, what="the end of the connection", pause=0.2)
    with pytest.raises(RequestError):
        connect(lab.endpoint, lab.tls("eva"), timeout=0.5)
    for ending in ("pem", "key"):
        (lab.folder / "lab" / f"eva-before.{ending}").replace(lab.folder / "lab" / f"eva.{ending}")


# The profile and the command


def test_a_network_address_needs_roles() -> None:
    tls = {"ca": "/a", "certificate": "/b", "key": "/c"}
    with pytest.raises(ValueError, match="needs `roles:`"):
        BusConfig(listen=("tls/0.0.0.0:7447",), tls=tls)
    with pytest.raises(ValueError, match="one role"):
        BusConfig(listen=("tls/0.0.0.0:7447",), tls=tls, roles={"observer": ("anna",), "operator": ("anna",)})


def test_a_certificate_that_cannot_be_written_leaves_no_key_behind(tmp_path: Path) -> None:
    authority(tmp_path)
    (tmp_path / "anna.pem").symlink_to("nowhere")  # not followed, and in the way
    with pytest.raises(HostError, match="can't be written"):
        sign(tmp_path, "anna", [], 1)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["anna.pem", "ca.key", "ca.pem"]
    (tmp_path / "anna.pem").unlink()
    sign(tmp_path, "anna", [], 1)


def test_the_command_makes_the_files_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "keys"
    assert main(["keys", str(folder), "robot", "--host", "robot.lab", "--host", "192.168.7.2"]) == 0
    assert main(["keys", str(folder), "anna", "--role", "operator"]) == 0
    assert "roles: {operator: [anna]}" in capsys.readouterr().out
    files = {"ca": "ca.pem", "certificate": "robot.pem", "key": "robot.key"}
    TlsConfig(**{name: str(folder / file) for name, file in files.items()}).check("tls")
    assert {file.name: oct(file.stat().st_mode & 0o777) for file in folder.glob("*.key")} == dict.fromkeys(
        ("ca.key", "robot.key", "anna.key"), "0o600"
    )
    before = (folder / "anna.key").read_bytes()
    assert "not overwritten" in refused("keys", str(folder), "anna", "--role", "observer")
    assert (folder / "anna.key").read_bytes() == before
    assert "one of them" in refused("keys", str(folder), "otto")
    assert "no name" in refused("keys", str(folder), "../otto", "--role", "observer")
    assert "folder you may write" in refused("keys", str(folder / "ca.pem" / "x"), "otto", "--role", "observer")
    (folder / "ca.key").unlink()
    assert "Put it back" in refused("keys", str(folder), "otto", "--role", "observer")
