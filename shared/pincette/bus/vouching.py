"""Both TLS sessions of a guard: with the client, and on its behalf with Zenoh."""

# Zenoh's access lists use the common name of a certificate. The guard checks the client's
# certificate, and presents to Zenoh another certificate with the same name, signed by an authority
# of this process.

import os
import ssl
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, cast

from pincette.bus.protocol import BusError
from pincette.security.identity import VIEWER, Credentials, Identity
from pincette.security.latest_time import LatestTime
from pincette.security.revocation import RevocationList

if TYPE_CHECKING:
    from pincette.security.certificates import Pair

DAYS = 36500.0
MOST_KEPT = 256
"""Number of clients whose substitute certificate is kept for the next connection."""


class Vouching:
    """TLS contexts of one guard; the authority's key is never written to a file.

    Raises SecurityError if the list of revoked certificates cannot be read.
    """

    def __init__(self, credentials: Credentials, time: LatestTime | None = None) -> None:
        """Create the contexts.

        ``time`` is the clock used to check whether certificates have expired.
        """
        # Imported only if there are certificates: the import takes as long as a short stop.
        from pincette.security.certificates import new_authority

        self._authority = new_authority(datetime.now(UTC), DAYS)
        self._credentials = credentials
        self._contexts: dict[tuple[str, float], ssl.SSLContext] = {}
        self._time = time or LatestTime()
        self.revoked = RevocationList(credentials.authority.parent)
        self.outer = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.outer.minimum_version = ssl.TLSVersion.TLSv1_3
        self.outer.verify_mode = ssl.CERT_REQUIRED
        self.outer.num_tickets = 0
        self.outer.load_verify_locations(credentials.authority)
        self.outer.load_cert_chain(credentials.certificate, credentials.private_key)

    @property
    def believed(self) -> str:
        """Return the certificates of the authorities that Zenoh trusts, as PEM."""
        return self._credentials.authority.read_text() + self._authority.certificate.decode()

    def inner(self, shown: Any) -> ssl.SSLContext:
        """Return the TLS context for Zenoh, with a certificate of the same name and expiry as the
        client's.

        ``shown`` is the client's certificate in the form of ``getpeercert``. Raises BusError if it
        was revoked, or if it had expired before the time of day was set back.
        """
        if self.revoked.holds(serial_of(shown)):
            raise BusError(f"the certificate of {_name(shown)} was revoked")
        name, ends_s = _name(shown), float(ssl.cert_time_to_seconds(shown["notAfter"]))
        if ends_s <= self._time.now().timestamp():
            raise BusError(f"the certificate of {name} has expired")
        found = self._contexts.get((name, ends_s))
        if found is None:
            if len(self._contexts) >= MOST_KEPT:
                self._contexts.clear()
            found = self._contexts[name, ends_s] = self._made(name, ends_s)
        return found

    def _made(self, name: str, ends_s: float) -> ssl.SSLContext:
        from pincette.security.certificates import issue

        now = datetime.now(UTC)
        left = datetime.fromtimestamp(ends_s, UTC) - now
        pair = issue(self._authority, Identity(name, VIEWER), (), now, left / timedelta(days=1))
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.load_verify_locations(self._credentials.authority)
        _load(context, pair)
        return context


def serial_of(shown: Any) -> int:
    """Return the serial number of a certificate in the form of ``getpeercert``."""
    return int(shown["serialNumber"], 16)


def _load(context: ssl.SSLContext, pair: "Pair") -> None:
    """Load a certificate from memory.

    OpenSSL's loader accepts only files. This function needs no file, so that clients can connect
    even if the disk is full.
    """
    with os.fdopen(os.memfd_create("certificate"), "wb") as file:
        file.write(pair.certificate + pair.private_key)
        file.flush()
        context.load_cert_chain(f"/proc/self/fd/{file.fileno()}")


def _name(shown: Any) -> str:
    subject = cast("tuple[tuple[tuple[str, str], ...], ...]", shown["subject"])
    for part in subject:
        for field, value in part:
            if field == "commonName":
                return value
    raise BusError("a certificate without a common name")
