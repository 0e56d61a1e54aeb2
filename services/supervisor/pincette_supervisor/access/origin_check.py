"""Names by which a supervisor may be asked, and places from which a page may ask it."""

from collections.abc import Iterable
from ipaddress import ip_address
from urllib.parse import urlsplit

LOOPBACK = "localhost"
DEFAULT_PORTS = {"http": 80, "https": 443}


def is_loopback(host: str) -> bool:
    """Whether this machine alone reaches an address; a name other than localhost may be any."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host.lower() == LOOPBACK


def name_of(place: str) -> str | None:
    """The host of a ``Host`` header, without its port; None where it is no place."""
    try:
        parts = urlsplit(f"//{place}")
        _ = parts.port
    except ValueError:
        return None
    if parts.netloc != place or "@" in place:
        return None
    return parts.hostname


def is_ours(place: str, names: Iterable[str]) -> bool:
    """Whether a ``Host`` header names this supervisor, by an address or a known name."""
    # A foreign page may let its own name lead to this address (DNS rebinding), and then reads and
    # sends as if it came from here. It cannot do so with an address in place of a name.
    host = name_of(place)
    if host is None:
        return False
    if host.lower() == LOOPBACK or host.lower() in names:
        return True
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def is_foreign(site: str | None, origin: str | None, host: str) -> bool:
    """Whether a foreign page sent a request that may change something, as Go 1.25 decides it."""
    # Browsers send ``Sec-Fetch-Site``, over plain HTTP beyond loopback ``Origin`` alone; a client
    # that sends neither is no browser. Another port of the same host is foreign too. The rule is
    # that of ``net/http.CrossOriginProtection``, but a proxy may add the default port to Host.
    if site is not None:
        return site not in ("same-origin", "none")
    if origin is None:
        return False
    try:
        parts = urlsplit(origin)
        place, default = parts.netloc.lower(), DEFAULT_PORTS.get(parts.scheme)
    except ValueError:
        return True
    return host.lower() not in (place, f"{place}:{default}") or not place
