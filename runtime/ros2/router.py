"""The configuration of a zenoh router that gives each peer the rights of its role: `rmw_zenohd`, or `zenohd`.

As on the bus, an observer reads, an operator commands, too, and an engineer also sets parameters. A certificate without
a role does nothing. The router knows each by the common name of its certificate. Source: zenoh, "Access control".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import COMMANDS, slug
from srl.runtime.ros2.commands import TOPICS
from srl.runtime.ros2.names import topic

_SEES = ["declare_subscriber", "liveliness_query", "declare_liveliness_subscriber", "liveliness_token"]
_ALL = [*_SEES, "put", "delete", "query", "reply", "declare_queryable"]
_READ = ("get_parameters", "get_parameter_types", "list_parameters", "describe_parameters")
_ACTION = ("send_goal", "cancel_goal", "get_result")
_SET = ("set_parameters", "set_parameters_atomically")


def configuration(config: BusConfig, instance: str, setpoints: list[str]) -> dict[str, Any]:
    """The router's configuration, for JSON5.

    Args:
        config: the profile's bus, with `ros2`, `tls` and `roles`.
        instance: the run's name.
        setpoints: the names of the profile's setpoints.
    Raises:
        ProfileError: the router isn't reached by TLS, or nobody has a role.
    """
    if config.ros2 is None or not config.ros2.router.startswith("tls/") or config.tls is None or not config.roles:
        problem = "a router with roles needs bus.ros2.router: tls/HOST:PORT, bus.tls and bus.roles"
        raise ProfileError("bus.ros2", problem, "See docs/ros2.md, or write the router's file yourself")
    domain = config.ros2.domain
    namespace = f"/{slug(instance)}" if config.ros2.namespace is None else config.ros2.namespace
    own = f"{domain}{namespace}"
    requests, sent = [f"{own}/{name}/**" for name in COMMANDS], list[str]()
    for setpoint in setpoints:
        where = f"{own}/{topic(setpoint)}"
        sent += [f"{where}/{last}/**" for last in (*TOPICS.values(), "joint_trajectory")]
        requests += [f"{where}/follow_joint_trajectory/_action/{name}/**" for name in _ACTION]
    # A part that begins with @ is matched by itself alone: the tokens, and what late joiners ask.
    anything = [f"{domain}/**", f"{domain}/**/@adv/**", f"@ros2_lv/{domain}/**"]
    rules = {
        "all": ("egress", _ALL, anything),
        "see": ("ingress", _SEES, anything),
        "read": ("ingress", ["query"], [f"{domain}/**/@adv/**", *(f"{own}/*/{name}/**" for name in _READ)]),
        "send": ("ingress", ["put"], sent),
        "request": ("ingress", ["query"], requests),
        "set": ("ingress", ["query"], [f"{own}/*/{name}/**" for name in _SET]),
        "limb": ("ingress", _ALL, anything),
    }
    commands = ["read", "request"] + ["send"] * bool(sent)
    given = {"observer": ["read"], "operator": commands, "engineer": [*commands, "set"]}
    subjects = [("limb", [_common_name(Path(config.tls.certificate))], ["limb"])]
    subjects += [(role, list(names), ["see", *given[role]]) for role, names in config.roles.items() if names]
    port = config.ros2.router.rpartition(":")[2]
    return {
        "mode": "router",
        "listen": {"endpoints": [f"tls/0.0.0.0:{port}"]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "routing": {"router": {"peers_failover_brokering": False}},
        "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},
        "queries_default_timeout": 600000,
        "transport": {"link": {"tls": {
            "root_ca_certificate": "ca.pem", "listen_certificate": "router.pem", "listen_private_key": "router.key",
            "enable_mtls": True, "close_link_on_expiration": True,
        }}},
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": [
                {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
                for name, (flow, messages, keys) in rules.items() if keys
            ],
            "subjects": [
                {"id": name, "link_protocols": ["tls"], "cert_common_names": names} for name, names, _ in subjects
            ],
            "policies": [{"rules": ["all", *allowed], "subjects": [name]} for name, _, allowed in subjects],
        },
    }  # fmt: skip


def _common_name(certificate: Path) -> str:
    """Of a certificate's subject, by which the router knows the limb. Raises ProfileError."""
    from cryptography import x509

    try:
        read = x509.load_pem_x509_certificate(certificate.read_bytes())
        return str(read.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)[0].value)
    except (OSError, ValueError, IndexError):
        raise ProfileError("bus.tls.certificate", f"{certificate} names nobody", "Make one: srl keys") from None
