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
