"""The forward proxy of an address, by the environment; pure.

httpx reads the same variables, but takes a network in ``NO_PROXY`` (10.0.0.0/8) for its first
address, and refuses every request if one is written as fd00::/8.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from urllib.parse import urlsplit

from pincette_supervisor.access.origin_check import is_loopback

DEFAULT_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True, slots=True)
class Proxy:
    """A forward proxy."""

    url: str
    """Address with a scheme; it may contain a name and a password."""
    variable: str
    """Name of the environment variable that sets it."""

    @property
    def over_tls(self) -> bool:
        """Whether the connection to the proxy itself is secured."""
        return self.url.lower().startswith("https:")

    def __str__(self) -> str:
        """Return where it is, without name and password."""
        return f"the proxy {self.url.rpartition('@')[2].rpartition('//')[2]} ({self.variable})"


def proxy_of(url: str, environment: Mapping[str, str]) -> Proxy | None:
    """Return the proxy for an address, or None if it is reached directly; raises ValueError."""
    place = urlsplit(url)
    host = (place.hostname or "").rstrip(".")
    # No proxy reaches a program of this machine by a loopback address.
    if is_loopback(host):
        return None
    names = environment.get("no_proxy") or environment.get("NO_PROXY") or ""
    port = place.port or DEFAULT_PORTS[place.scheme]
    if any(_covers(entry.strip().lower(), host, port) for entry in names.split(",")):
        return None
    for scheme in (place.scheme, "all"):
        for variable in (f"{scheme}_proxy", f"{scheme}_proxy".upper()):
            if found := environment.get(variable, "").strip():
                return Proxy(found if "://" in found else f"http://{found}", variable)
    return None


def _covers(entry: str, host: str, port: int) -> bool:
    """Whether an entry of ``NO_PROXY`` (name, suffix, address, network, each with port) is meant.

    An entry that cannot be understood covers nothing.
    """
    if entry in ("", "*"):
        return entry == "*"
    with suppress(ValueError):
        return ip_address(host) in ip_network(entry.strip("[]"), strict=False)
    name, colon, wanted = entry.rpartition(":")
    if colon and wanted.isdecimal():
        if int(wanted) != port:
            return False
        return _covers(name, host, port)
    suffix = entry.removeprefix("*").lstrip(".")
    return bool(suffix) and (host == suffix or host.endswith(f".{suffix}"))
