"""Certificates for the bus over the network: an authority of one's own, and what it signs (X.509, ECDSA P-256)."""

from __future__ import annotations

import datetime
import ipaddress
import os
import re
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from srl.runtime.contracts.errors import HostError, RequestError

AUTHORITY = "ca"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,62}")
_AUTHORITY_DAYS = 3650
_EARLY = datetime.timedelta(minutes=5)  # a clock on the other machine may be late


def authority(folder: Path) -> bool:
    """Makes `ca.pem` and `ca.key` in a folder, unless they are there. Returns whether it made them.

    Raises:
        HostError: a file can't be written, or only one of the two is there.
    """
    certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    if certificate.exists() and key.exists():
        return False
    if certificate.exists() or key.exists():
        lost = key if certificate.exists() else certificate
        raise HostError(str(lost), "the other file of the authority is there, this one isn't", "Put it back")
    secret = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "srl authority")])
    usage = {"key_cert_sign": True, "crl_sign": True}
    signed = (
        _begun(name, name, secret.public_key(), _AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(**usage), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(secret.public_key()), critical=False)
        .sign(secret, hashes.SHA256())
    )
    _write(folder, AUTHORITY, signed, secret)
    return True


def sign(folder: Path, name: str, hosts: Sequence[str], days: int) -> None:
    """Makes `NAME.pem` and `NAME.key` in a folder, signed by its authority.

    Args:
        folder: holds the authority's two files.
        name: the common name; `bus.roles` knows a client by it.
        hosts: the names and addresses by which clients call the service; none for a client. A service may connect,
            too: to a router.
        days: how long it holds good.
    Raises:
        RequestError: the name is none, or its files are there.
        HostError: the authority's files can't be read, or the new ones not be written.
    """
    if not _NAME.fullmatch(name) or name == AUTHORITY:
        raise RequestError("NAME", f"'{name}' is no name for a certificate", "Take letters, digits, and . _ - @")
    for file in (folder / f"{name}.pem", folder / f"{name}.key"):
        if file.exists():
            raise RequestError(str(file), "it is there, and is not overwritten", "Move it away, or take another name")
    issuer, signer = _read(folder)
    secret = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH] + [ExtendedKeyUsageOID.SERVER_AUTH] * bool(hosts)
    builder = (
        _begun(subject, issuer.subject, secret.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False)
    )
    if hosts:
        builder = builder.add_extension(x509.SubjectAlternativeName([_host(host) for host in hosts]), critical=False)
    _write(folder, name, builder.sign(signer, hashes.SHA256()), secret)


def _begun(subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _EARLY)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _usage(**given: bool) -> x509.KeyUsage:
    none = dict.fromkeys(
        ("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
         "key_cert_sign", "crl_sign", "encipher_only", "decipher_only"), False,
    )  # fmt: skip
    return x509.KeyUsage(**(none | given))


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError:
        raise RequestError("--host", f"'{host}' is no name or address", "Give it as clients call it") from None


def _read(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    try:
        issuer = x509.load_pem_x509_certificate(certificate.read_bytes())
        signer = serialization.load_pem_private_key(key.read_bytes(), password=None)
    except OSError as error:
        raise HostError(str(error.filename), f"can't be read: {error.strerror}", "Run it as its owner") from None
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise HostError(
            str(folder), "the authority's files aren't a certificate and its key", "Put them back"
        ) from None
    if not isinstance(signer, ec.EllipticCurvePrivateKey) or signer.public_key() != issuer.public_key():
        raise HostError(str(key), f"it isn't the key of {certificate.name}", "Put the right one back")
    return issuer, signer


def _write(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    made: list[Path] = []
    for file, content, mode in (
        (folder / f"{name}.key", secret, 0o600),
        (folder / f"{name}.pem", certificate.public_bytes(pem), 0o644),
    ):
        try:
            descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, mode)
            made.append(file)
            with os.fdopen(descriptor, "wb") as opened:
                opened.write(content)
        except OSError as error:
            for half in made:  # else the next call would find a key without its certificate, and refuse
                half.unlink(missing_ok=True)
            raise HostError(str(file), f"can't be written: {error.strerror}", "Name a folder you may write") from None
