"""Mutual TLS: the certificate files of one side of a connection, for the bus and for devices over zenoh."""

from __future__ import annotations

import ssl
from pathlib import Path

from pydantic import ConfigDict, Field, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError


class TlsConfig(BaseModel):
    """The `tls:` entry: absolute paths of PEM files. Both sides present a certificate signed by `ca`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ca: str = Field(description="certificate of the authority that signs this service and its clients")
    certificate: str = Field(description="this side's certificate")
    key: str = Field(description="this side's private key")

    @model_validator(mode="after")
    def _absolute(self) -> TlsConfig:
        for name in ("ca", "certificate", "key"):
            if not Path(getattr(self, name)).is_absolute():
                raise ValueError(f"'{name}' must be an absolute path, as the service has no folder of its own")
        return self

    def check(self, place: str) -> None:
        """Reads the files, as the connection will.

        Raises:
            ProfileError: one isn't there or can't be read, or they don't fit; `place` is the entry's.
        """
        for name in ("ca", "certificate", "key"):
            path = getattr(self, name)
            try:
                Path(path).read_bytes()
            except FileNotFoundError:
                raise ProfileError(f"{place}.{name}", f"there is no file {path}", "Name an existing file") from None
            except OSError as error:
                problem = f"{path} can't be read: {error.strerror}"
                raise ProfileError(f"{place}.{name}", problem, "Name a file that srl may read") from None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        try:
            context.load_verify_locations(self.ca)
        except ssl.SSLError:
            remedy = "Give certificates in PEM form"
            raise ProfileError(f"{place}.ca", f"{self.ca} holds no certificate", remedy) from None
        try:
            context.load_cert_chain(self.certificate, self.key, password=lambda: "")
        except ssl.SSLError as error:
            problem = f"{self.certificate} and {self.key} aren't a certificate and its key ({error.reason or error})"
            raise ProfileError(place, problem, "Give both in PEM form, the key without a password") from None

    def check_client(self, place: str) -> None:
        """Tries the certificate as that of a side that connects, against a server that trusts the same authority.

        Raises:
            ProfileError: the server would refuse it; `place` is the entry's.
        """
        server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        client.check_hostname, client.verify_mode, server.verify_mode = False, ssl.CERT_NONE, ssl.CERT_REQUIRED
        server.load_verify_locations(self.ca)
        to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
        ends = []
        for context, read, write in ((client, to_client, to_server), (server, to_server, to_client)):
            context.load_cert_chain(self.certificate, self.key, password=lambda: "")
            ends.append(context.wrap_bio(read, write, server_side=context is server))
        for end in ends * 3:  # more turns than a handshake has
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLError as error:
                reason = getattr(error, "verify_message", "") or error.reason
                problem = f"a router that trusts {self.ca} refuses {self.certificate} ({reason})"
                remedy = "Make it anew: srl keys FOLDER NAME --host HOST"
                raise ProfileError(f"{place}.certificate", problem, remedy) from None
