"""Certificates of a private authority: P-256, SHA-256, X.509 version 3 after RFC 5280."""

# A program that serves may be connected to at the hosts that its certificate names; a person's
# certificate names none, so that it is not mistaken for a program's.

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from pincette.security.identity import AUTHORITY, Identity

CLOCKS_DIFFER = timedelta(hours=1)
"""Largest difference between the clocks of two hosts at which a new certificate is still
accepted.
"""


@dataclass(frozen=True, slots=True)
class Pair:
    """A certificate and its private key, both as PEM."""

    certificate: bytes
    private_key: bytes


@dataclass(frozen=True, slots=True)
class Facts:
    """Content of a certificate."""

    identity: Identity
    hosts: tuple[str, ...]
    begins: datetime
    ends: datetime
    serial: int


def new_authority(now: datetime, days: float) -> Pair:
    """Create an authority, with a random part in its name, that signs no other authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    serial = x509.random_serial_number()
    name = _named(Identity(f"pincette {serial % 2**32:08x}", AUTHORITY))
    builder = (
        _begun(name, name, key, now, days, serial)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return _signed(builder, key, key)


def issue(
    authority: Pair, identity: Identity, hosts: Sequence[str], now: datetime, days: float
) -> Pair:
    """Sign a certificate with a new key, valid at most as long as the authority.

    Raises ValueError.
    """
    signer = load_pem_private_key(authority.private_key, None)
    if not isinstance(signer, ec.EllipticCurvePrivateKey):
        raise ValueError("the authority's key is of another kind: expected an elliptic curve")  # noqa: TRY004  a bad file
    above = x509.load_pem_x509_certificate(authority.certificate)
    key = ec.generate_private_key(ec.SECP256R1())
    days = min(days, (above.not_valid_after_utc - now) / timedelta(days=1))
    serves = [ExtendedKeyUsageOID.SERVER_AUTH] if identity.serves else []
    builder = (
        _begun(_named(identity), above.subject, key, now, days, x509.random_serial_number())
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, *serves]), critical=False
        )
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
        )
    )
    if identity.serves:
        places = x509.SubjectAlternativeName([_place(host) for host in hosts])
        builder = builder.add_extension(places, critical=False)
    return _signed(builder, key, signer)


def read(certificate: bytes) -> Facts:
    """Return the content of a certificate; raises ValueError if it is invalid, or of another
    kind.
    """
    found = x509.load_pem_x509_certificate(certificate)
    names = (NameOID.COMMON_NAME, NameOID.ORGANIZATIONAL_UNIT_NAME)
    attributes = [found.subject.get_attributes_for_oid(name) for name in names]
    if not all(attributes):
        raise ValueError("a certificate that was not made by `pincette security`")
    name, role = (str(one[0].value) for one in attributes)
    try:
        extension = found.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        hosts: list[str] = []
    else:
        hosts = extension.value.get_values_for_type(x509.DNSName)
        hosts += map(str, extension.value.get_values_for_type(x509.IPAddress))
    begins, ends = found.not_valid_before_utc, found.not_valid_after_utc
    return Facts(Identity(name, role), tuple(hosts), begins, ends, found.serial_number)


def signed_by(certificate: bytes, authority: bytes) -> bool:
    """Return whether an authority has signed a certificate; raises ValueError for invalid ones."""
    above = x509.load_pem_x509_certificate(authority)
    try:
        x509.load_pem_x509_certificate(certificate).verify_directly_issued_by(above)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return True


def belongs(pair: Pair) -> bool:
    """Return whether a private key belongs to a certificate; raises ValueError if unreadable."""
    key = load_pem_private_key(pair.private_key, None)
    return key.public_key() == x509.load_pem_x509_certificate(pair.certificate).public_key()


def _begun(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    now: datetime,
    days: float,
    serial: int,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(serial)
        .not_valid_before(now - CLOCKS_DIFFER)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _signed(
    builder: x509.CertificateBuilder,
    key: ec.EllipticCurvePrivateKey,
    signer: ec.EllipticCurvePrivateKey,
) -> Pair:
    return Pair(
        builder.sign(signer, hashes.SHA256()).public_bytes(Encoding.PEM),
        key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _named(identity: Identity) -> x509.Name:
    return x509.Name(
        [
            x509.NameAttribute(NameOID.COMMON_NAME, identity.name),
            x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, identity.role),
        ]
    )


def _place(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
