"""Diagnosis of a failed link by a handshake with Python's TLS, since Zenoh does not report the
reason.
"""

import errno
import socket
import ssl
from typing import Any, cast

from pincette.bus.topology import address_of
from pincette.core.listening import bound
from pincette.security.identity import Credentials

ANSWER_S, ALERT_S = 3.0, 0.5
"""Time limits, in s, for a reply (Zenoh closes connections of other protocols after 1 s), and for
an alert after the handshake.
"""
PLAIN = "it does not speak TLS: is [bus] pki missing in its rig file?"
REFUSED = "it does not accept the certificate {ours}"
UNKNOWN = "it trusts another authority than the one that signed {ours}"
REASONS = {
    "CERTIFICATE_REQUIRED": "it requires a certificate, and none was sent",
    "UNKNOWN_CA": UNKNOWN,
    "BAD_SIGNATURE": UNKNOWN,
    "DECRYPT_ERROR": UNKNOWN,
    "BAD_CERTIFICATE": REFUSED,
    "CERTIFICATE_EXPIRED": (
        "for it the certificate {ours} has expired: check its clock and this one's"
    ),
    "WRONG_VERSION_NUMBER": PLAIN,
    "UNEXPECTED_EOF": PLAIN,
}
"""Reasons for a rejection by the other side, by a substring of OpenSSL's error name."""
ALERT = "ALERT"
"""Substring of OpenSSL's name for an alert from the other side, as in
``TLSV13_ALERT_CERTIFICATE_REQUIRED``.
"""


def diagnose_link(place: str, credentials: Credentials | None, name: str = "") -> str:
    """Return the reason why no link with the certificate of ``name`` is possible; "" if one is."""
    address = address_of(place)
    try:
        with socket.create_connection(address, ANSWER_S) as line:
            line.settimeout(ANSWER_S)
            if credentials is None:
                return _speaks_tls(place, line)
            return _shaken(place, address[0], line, credentials, name)
    except ConnectionRefusedError:
        return f"no program listens at {place}"
    except TimeoutError:
        return f"{place} does not answer within {ANSWER_S:g} s"
    except OSError as error:
        return f"{place}: {error.strerror or error}"


def is_taken(endpoint: str) -> bool:
    """Return whether another program listens at an endpoint of this machine."""
    host, port = address_of(endpoint)
    try:
        bound(host, port).close()
    except OSError as error:
        return error.errno == errno.EADDRINUSE
    return False


def _shaken(place: str, host: str, line: socket.socket, credentials: Credentials, name: str) -> str:
    """Return the result of a TLS handshake with these credentials."""
    ours = credentials.certificate
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(credentials.authority)
        context.load_cert_chain(ours, credentials.private_key)
        with context.wrap_socket(line, server_hostname=host) as wrapped:
            shown = _shown(wrapped)
            if name not in ("", shown):
                return f"{place} sent the certificate of {shown}, not that of {name}"
            return f"{place}: {REFUSED.format(ours=ours)}" if _ended(wrapped) else ""
    except ssl.SSLCertVerificationError as error:
        return f"{place}: its certificate is not trusted here: {error.verify_message}"
    except ssl.SSLError as error:
        return f"{place}: {_words(error).format(ours=ours)}"


def _ended(wrapped: ssl.SSLSocket) -> bool:
    """Return whether the other side closes the connection after it has received our certificate."""
    # With TLS 1.3 the client's handshake is complete before the server has checked its certificate.
    wrapped.settimeout(ALERT_S)
    try:
        return wrapped.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True


def _shown(wrapped: ssl.SSLSocket) -> str:
    """Return the common name in the other side's certificate."""
    subject = cast(Any, wrapped.getpeercert() or {}).get("subject", ())
    return next((value for part in subject for field, value in part if field == "commonName"), "")


def _speaks_tls(place: str, line: socket.socket) -> str:
    """Return the reason if a plain link fails because the other side requires TLS, otherwise ""."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(line):
            pass
    except (ssl.SSLError, OSError) as error:
        if not isinstance(error, ssl.SSLError) or ALERT not in _openssl_code(error):
            return ""
    return f"{place} speaks TLS: set the folder of certificates as [bus] pki in the rig file"


def _words(error: ssl.SSLError) -> str:
    code = _openssl_code(error)
    found = (words for name, words in REASONS.items() if name in code)
    return next(found, code.lower().replace("_", " ") or str(error))


def _openssl_code(error: ssl.SSLError) -> str:
    """Return OpenSSL's name of its error, such as ``TLSV13_ALERT_CERTIFICATE_REQUIRED``, or ""."""
    return error.reason or ""
