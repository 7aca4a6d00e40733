"""What the bus process listens on: its Unix socket, and the network by mutual TLS only."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from helpers.bus import Instance, sockets

from runtime.bus.client import Client, connect
from runtime.contracts.errors import RequestError
from runtime.contracts.tls import TlsConfig


def _certificates(folder: Path) -> dict[str, TlsConfig]:
    """An authority, and one nobody knows, each with a certificate for localhost."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], check=True, capture_output=True, cwd=folder)

    (folder / "extensions").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
    for name in ("lab", "stranger"):
        key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
        openssl(
            "req",
            "-x509",
            *key,
            "-keyout",
            f"{name}-ca.key",
            "-out",
            f"{name}-ca.pem",
            "-subj",
            f"/CN={name} CA",
        )
        openssl("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        sign = (
            "-CA",
            f"{name}-ca.pem",
            "-CAkey",
            f"{name}-ca.key",
            "-CAcreateserial",
            "-extfile",
            "extensions",
        )
        openssl("x509", "-req", "-in", f"{name}.csr", "-out", f"{name}.pem", *sign)
    lab = str(folder / "lab-ca.pem")
    return {
        name: TlsConfig(ca=lab, certificate=str(folder / f"{name}.pem"), key=str(folder / f"{name}.key"))
        for name in ("lab", "stranger")
    }


def test_the_network_is_reached_by_mutual_tls_only(tmp_path: Path) -> None:
    import shutil
    import socket

    if shutil.which("openssl") is None:
        pytest.skip("openssl isn't installed; it makes the certificates")
    tls = _certificates(tmp_path)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    instance = Instance(tmp_path / "one", listen=[f"tls/127.0.0.1:{port}"], tls=tls["lab"].model_dump())
    try:
        with connect(f"tls/localhost:{port}", tls["lab"]) as client:
            assert isinstance(client, Client)
            assert client.instance == "one"
            assert client.command("start") == {"ok": True, "state": "active"}
        for certificate, endpoint in (
            (tls["stranger"], f"tls/localhost:{port}"),
            (None, f"tcp/127.0.0.1:{port}"),
        ):
            with pytest.raises(RequestError):
                connect(endpoint, certificate, timeout=0.5)
        assert sockets(instance.process.pid) == {
            f"unix {instance.run_folder.bus_socket}",
            f"tcp 0100007F:{port:04X}",
        }
    finally:
        instance.close()
