"""What is wrong with the certificates of a bus over the network, before a client finds out. Nothing is changed."""

from __future__ import annotations

import datetime
import shlex
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from srl.runtime.contracts.tls import TlsConfig

SOON = datetime.timedelta(days=14)
_OTHERS = stat.S_IRWXG & ~stat.S_IRGRP | stat.S_IRWXO  # the service's group may read the key


class Warning(NamedTuple):
    """`bad`: no client gets in, or anybody might; else it will be so soon. `command` mends it."""

    bad: bool
    problem: str
    remedy: str
    command: str


def warnings(tls: TlsConfig, now: datetime.datetime | None = None) -> Iterator[Warning]:
    """Looks at the three files.

    Args:
        tls: the profile's entry.
        now: with its time zone; default: the present.
    """
    now = now or datetime.datetime.now(datetime.UTC)
    certificate, authority, key = Path(tls.certificate), Path(tls.ca), Path(tls.key)
    anew = f"srl keys FOLDER {shlex.quote(certificate.stem)} --host NAME"
    read = dict[Path, x509.Certificate]()
    for path in (authority, certificate):
        try:
            read[path] = x509.load_pem_x509_certificate(path.read_bytes())
        except OSError as error:
            yield Warning(True, f"{path} can't be read: {error.strerror}", "Put it there, for the service's user", anew)
        except ValueError:
            yield Warning(True, f"{path} holds no certificate", "Give it in PEM form", anew)
    for path, found in read.items():
        yield from _dates(path, found, now, anew)
    if len(read) == 2:
        try:
            read[certificate].verify_directly_issued_by(read[authority])
        except (ValueError, TypeError, InvalidSignature):
            remedy = "Clients know the authority: let it sign this one, in the folder of its key"
            yield Warning(True, f"{certificate} isn't signed by {authority}", remedy, anew)
    yield from _key(key, read.get(certificate), anew)


def _dates(path: Path, found: x509.Certificate, now: datetime.datetime, anew: str) -> Iterator[Warning]:
    begins, ends = found.not_valid_before_utc, found.not_valid_after_utc
    remedy = "Make a new one where the authority's key is, and copy it here"
    if ends <= now:
        yield Warning(True, f"{path} has expired, on {ends:%Y-%m-%d}", remedy, anew)
    elif begins > now:
        problem = f"{path} isn't valid before {begins:%Y-%m-%d %H:%M} UTC"
        yield Warning(True, problem, "Is this host's clock right?", "timedatectl")
    elif ends - now < SOON:
        yield Warning(False, f"{path} expires on {ends:%Y-%m-%d}", remedy, anew)


def _key(path: Path, certificate: x509.Certificate | None, anew: str) -> Iterator[Warning]:
    try:
        mode, content = path.stat().st_mode, path.read_bytes()
    except OSError as error:
        command = f"sudo chown srl {shlex.quote(str(path))} && sudo chmod 600 {shlex.quote(str(path))}"
        yield Warning(True, f"{path} can't be read: {error.strerror}", "Give it to the service's user", command)
        return
    if mode & _OTHERS:
        problem = f"{path} may be read or written by others (mode {stat.S_IMODE(mode):o})"
        yield Warning(
            True, problem, "Close it; if others had access, make a new one", f"chmod 600 {shlex.quote(str(path))}"
        )
    try:
        fits = certificate is None or load_pem_private_key(content, None).public_key() == certificate.public_key()
    except (ValueError, TypeError, UnsupportedAlgorithm):
        fits = False
    if not fits:
        yield Warning(True, f"{path} isn't the certificate's key", "Put the right pair there", anew)
