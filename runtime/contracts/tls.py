"""Mutual TLS: the certificate files of one side of a connection, for the bus and for devices over zenoh."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, model_validator


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
