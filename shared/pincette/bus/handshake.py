"""Why two programs do not come together: looked at over a link of one's own, then put in words.

Zenoh says of a handshake that fails only that it failed. Python's own TLS, with the same files, is
told the reason by the other side.
"""

import socket
import ssl
from typing import Any, cast

from pincette.bus.links import address_of
from pincette.security.identity import Credentials

ANSWER_S, ALERT_S = 3.0, 0.5
"""How long to wait for an answer, and for a word of refusal after the handshake.

Zenoh that is spoken to in a language it does not know hangs up after 1 s.
"""
PLAIN = "it does not speak TLS: is [bus] pki missing where that one starts?"
REFUSED = "it does not take the certificate {ours}"
UNKNOWN = "it believes another authority than the one that has signed {ours}"
REASONS = {
    "CERTIFICATE_REQUIRED": "it wants a certificate, and none was shown",
    "UNKNOWN_CA": UNKNOWN,
    "BAD_SIGNATURE": UNKNOWN,
    "DECRYPT_ERROR": UNKNOWN,
    "BAD_CERTIFICATE": REFUSED,
    "CERTIFICATE_EXPIRED": "to it the certificate {ours} has ended: see its clock and this one's",
    "WRONG_VERSION_NUMBER": PLAIN,
    "UNEXPECTED_EOF": PLAIN,
}
"""What the other side means, by a part of OpenSSL's name for it."""


def why_no_link(place: str, credentials: Credentials | None, name: str = "") -> str:
    """Why no link to an endpoint can be made, as a person would say it; empty where it can.

    ``name`` is whose certificate the other side should show; empty: anybody's of our authority.
    """
    address = address_of(place)
    try:
        with socket.create_connection(address, ANSWER_S) as line:
            line.settimeout(ANSWER_S)
            if credentials is None:
                return _speaks_tls(place, line)
            return _shaken(place, address[0], line, credentials, name)
    except ConnectionRefusedError:
        return f"nobody listens at {place}"
    except TimeoutError:
        return f"{place} does not answer within {ANSWER_S:g} s"
    except OSError as error:
        return f"{place}: {error.strerror or error}"


def _shaken(place: str, host: str, line: socket.socket, credentials: Credentials, name: str) -> str:
    """What comes of a handshake with these credentials."""
    ours = credentials.certificate
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(credentials.authority)
        context.load_cert_chain(ours, credentials.private_key)
        with context.wrap_socket(line, server_hostname=host) as wrapped:
            shown = _shown(wrapped)
            if name not in ("", shown):
                return f"{place} shows the certificate of {shown}, not of {name}"
            return f"{place}: {REFUSED.format(ours=ours)}" if _ended(wrapped) else ""
    except ssl.SSLCertVerificationError as error:
        return f"{place}: its certificate is not believed here: {error.verify_message}"
    except ssl.SSLError as error:
        return f"{place}: {_words(error).format(ours=ours)}"


def _ended(wrapped: ssl.SSLSocket) -> bool:
    """Whether the other side ends the connection once it has seen our certificate.

    With TLS 1.3 a client is done before the server has looked at it.
    """
    wrapped.settimeout(ALERT_S)
    try:
        return wrapped.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True


def _shown(wrapped: ssl.SSLSocket) -> str:
    """Common name in the certificate of the other side."""
    subject = cast(Any, wrapped.getpeercert() or {}).get("subject", ())
    return next((value for part in subject for field, value in part if field == "commonName"), "")


def _speaks_tls(place: str, line: socket.socket) -> str:
    """Whether one that is to be spoken to in plain words wants TLS."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with context.wrap_socket(line):
            pass
    except (ssl.SSLError, OSError) as error:
        spoke = isinstance(error, ssl.SSLError) and "ALERT" in (error.reason or "")
        if not spoke:
            return ""
    return f"{place} speaks TLS: name the folder of certificates, [bus] pki, in the rig file"


def _words(error: ssl.SSLError) -> str:
    reason = error.reason or ""
    found = (words for name, words in REASONS.items() if name in reason)
    return next(found, reason.lower().replace("_", " ") or str(error))
