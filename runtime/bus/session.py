"""zenoh sessions of the service and of its clients: explicit endpoints, no scouting.

A session must be closed before its process ends, or the process hangs. A process that uses zenoh must never fork.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import zenoh

from srl.runtime.contracts.errors import HostError, NoAnswerError
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import ROLES, Keys

LONGEST_PATH = 107  # bytes of a Unix socket's path, Linux
LONGEST_MESSAGE = 1 << 17  # bytes of what a client sends: zenoh would take 1 GiB into this process's memory
SOCKET_UMASK = 0o117  # the socket's mode is 0660: the service's user and group


def serve(socket: Path, config: BusConfig, keys: Keys) -> zenoh.Session:
    """Opens the service's session. It listens only on its Unix socket and on the profile's endpoints.

    It sets the process's umask, so that the socket never has another mode, not even for an instant.

    Raises:
        HostError: zenoh can't listen on an endpoint.
    """
    if len(os.fsencode(socket)) > LONGEST_PATH or set(str(socket)) & set("?#;"):
        raise HostError(str(socket), "this path can't name a Unix socket", "Set SRL_RUNTIME_DIR to a short, plain path")
    os.umask(SOCKET_UMASK)
    endpoints = [f"unixsock-stream/{socket}", *config.listen]
    content = _base("peer") | {
        "listen": {"endpoints": endpoints, "exit_on_failure": True, "timeout_ms": 0},
        "connect": {"endpoints": []},
        "adminspace": {"enabled": False},
        "access_control": _access(keys, config),
    }
    link: dict[str, Any] = {"rx": {"max_message_size": LONGEST_MESSAGE}}
    if config.tls is not None:
        # A client's connection ends with its certificate.
        link["tls"] = _tls(config.tls, "listen") | {"close_link_on_expiration": True}
    content["transport"]["link"] = link
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
    except zenoh.ZError as error:
        where = ", ".join(endpoints)
        raise HostError(
            f"bus ({where})", f"zenoh can't listen: {_reason(error)}", "Free the address, or see bus.tls"
        ) from None


def join(endpoint: str, tls: TlsConfig | None = None, timeout: float = 2.0) -> zenoh.Session:
    """Opens a client's session. Raises NoAnswerError if the endpoint does not answer within `timeout` s."""
    content = _base("client") | {
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": round(timeout * 1000),
            "exit_on_failure": True,
            "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
        }
    }
    if tls is not None:
        content["transport"]["link"] = {"tls": client_tls(tls)}
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
    except zenoh.ZError as error:
        problem = f"nobody answered: no connection ({_reason(error)})"
        raise NoAnswerError(f"bus ({endpoint})", problem, "Is the service running? `srl stop` needs no bus") from None


def _reason(error: zenoh.ZError) -> str:
    return str(error).partition(" at /")[0].rstrip(". ")


def _base(mode: str) -> dict[str, Any]:
    return {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"shared_memory": {"enabled": False}},  # messages are small; shared memory would only lock memory
    }


def _tls(tls: TlsConfig, side: str) -> dict[str, Any]:
    return {
        "root_ca_certificate": tls.ca,
        f"{side}_certificate": tls.certificate,
        f"{side}_private_key": tls.key,
        "enable_mtls": True,
    }


def has_subscriber(publisher: zenoh.Publisher) -> bool:
    """Whether there is a subscriber. zenoh declares a bool but returns an object that is always true."""
    status: Any = publisher.matching_status
    return bool(getattr(status, "matching", status))


def client_tls(tls: TlsConfig) -> dict[str, Any]:
    """zenoh's options of a TLS link that this side opens."""
    return _tls(tls, "connect")


def _access(keys: Keys, config: BusConfig) -> dict[str, Any]:
    """The rules for clients. Only the service publishes for the instance.

    On this machine they may read, query and put setpoints. From the network a certificate may read, and ask under
    the keys of its role alone; one whose name the profile doesn't have may do nothing. A client hears what is
    published, and no other client's setpoints.
    """
    published = [f"{keys.root}/state/**", keys.status, keys.events]
    rules: list[dict[str, Any]] = [
        {"id": "setpoints", "flows": ["ingress"], "messages": ["put"], "key_exprs": [f"{keys.root}/setpoint/**"]},
        # zenoh grants what a rule's key includes as a whole. So `**` is named, or who asks for it would get nothing in
        # silence. What reaches a client is bounded by "speak", and what changes anything takes its exact key.
        {"id": "ask", "flows": ["ingress"], "messages": ["query"], "key_exprs": ["**"]},
        {"id": "hear", "flows": ["ingress"], "messages": ["declare_subscriber"], "key_exprs": ["**"]},
        {"id": "no role", "flows": ["ingress"], "messages": ["query", "put"], "key_exprs": [f"{keys.root}/as/**"]},
        {
            "id": "read",
            "flows": ["ingress"],
            "messages": ["query"],
            "key_exprs": published,
        },
        {
            "id": "presence",
            "flows": ["ingress"],
            "messages": ["liveliness_query", "declare_liveliness_subscriber"],
            "key_exprs": ["**"],
        },
        {"id": "publish", "flows": ["egress"], "messages": ["put"], "key_exprs": published},
        {
            "id": "speak",
            "flows": ["egress"],
            "messages": ["reply", "liveliness_token", "declare_queryable", "declare_subscriber"],
            "key_exprs": [f"{keys.root}/**"],
        },
    ]
    subjects: list[dict[str, Any]] = [{"id": "local", "link_protocols": ["unixsock-stream", "tcp"]}]
    everybody = ["hear", "presence", "publish", "speak"]
    policies = [{"rules": ["setpoints", "ask", "no role", *everybody], "subjects": ["local"]}]
    roles: dict[str, tuple[str, ...]] = {str(role): names for role, names in config.roles.items()}
    for role in ROLES:
        if names := roles.get(role, ()):
            own = Keys(keys.instance, role)
            rules.append({"id": role, "flows": ["ingress"], "messages": ["query"], "key_exprs": [f"{own.asked}/**"]})
            given = ["read", role, *everybody]
            if not own.reads_only:
                into = f"{role}'s setpoints"
                rules.append({"id": into, "flows": ["ingress"], "messages": ["put"], "key_exprs": [own.setpoints]})
                given.append(into)
            subjects.append({"id": role, "link_protocols": ["tls"], "cert_common_names": list(names)})
            policies.append({"rules": given, "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule | {"permission": "deny" if rule["id"] == "no role" else "allow"} for rule in rules],
        "subjects": subjects,
        "policies": policies,
    }
