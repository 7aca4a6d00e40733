from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from srl.runtime.profile.bus import BusConfig

TLS = {"ca": "/etc/srl/ca.pem", "certificate": "/etc/srl/c.pem", "key": "/etc/srl/k.pem"}


def test_closed_by_default() -> None:
    config = BusConfig()
    assert (config.listen, config.tls, config.decimate) == ((), None, 10)


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/127.9.9.9:1"])
def test_loopback_needs_no_certificates(endpoint: str) -> None:
    assert BusConfig(listen=(endpoint,)).listen == (endpoint,)


def test_tls_opens_to_the_network() -> None:
    content = {"listen": ["tls/0.0.0.0:7447"], "tls": TLS, "roles": {"observer": ["otto"]}}
    assert BusConfig.model_validate(content).tls is not None


@pytest.mark.parametrize(
    ("options", "output"),
    [
        ({"listen": ["tcp/0.0.0.0:7447"]}, "anyone on the network"),
        ({"listen": ["tcp/0.0.0.0:7447"], "tls": TLS}, "anyone on the network"),
        ({"listen": ["tcp/[::]:7447"], "tls": TLS}, "anyone on the network"),
        ({"listen": ["tcp/localhost:7447"]}, "anyone on the network"),
        ({"listen": ["tcp/robot:7447"], "tls": TLS}, "anyone on the network"),
        ({"listen": ["tls/0.0.0.0:7447"]}, "needs `tls:`"),
        ({"listen": ["tls/0.0.0.0:7447"], "tls": TLS}, "needs `roles:`"),
        ({"listen": ["udp/127.0.0.1:7447"]}, "must read"),
        ({"listen": ["tcp/127.0.0.1:7447#iface=eth0"]}, "must read"),
        ({"listen": ["tcp/127.0.0.1:7447?rel=0"]}, "must read"),
        ({"listen": ["tcp/127.0.0.1:99999"]}, "must read"),
        ({"decimate": 0}, "greater than or equal to 1"),
        ({"tls": TLS | {"key": "k.pem"}}, "absolute"),
        ({"lissten": []}, "Extra inputs"),
    ],
)
def test_what_would_be_open_is_refused(options: dict[str, Any], output: str) -> None:
    with pytest.raises(ValidationError, match=output):
        BusConfig.model_validate(options)
