"""Addresses that follow from the tables ``[bus]`` and ``[supervisor]`` of a rig file."""

from typing import TYPE_CHECKING, Literal


class BusAddresses:
    """Addresses of the routers of a rig."""

    if TYPE_CHECKING:
        host: str
        port: int
        router: str | None
        upstream: str | None
        served_at: Literal["upstream", "rig"]

    __slots__ = ()

    @property
    def router_at(self) -> tuple[str, int]:
        """Return host and port of the router, for any rig."""
        return (self.host, self.port) if self.router is None else _address(self.router)

    @property
    def upstream_at(self) -> tuple[str, int] | None:
        """Host and port of the laboratory server's router; None if there is none."""
        return None if self.upstream is None else _address(self.upstream)

    @property
    def served_upstream(self) -> bool:
        """Return whether supervisor and recorder use another router than the loop does."""
        return self.upstream is not None and self.served_at == "upstream"

    @property
    def served_by(self) -> tuple[str, int]:
        """Return host and port of the router that supervisor, recorder and tools use."""
        above = self.upstream_at
        return self.router_at if above is None or not self.served_upstream else above


def _address(place: str) -> tuple[str, int]:
    host, _, port = place.rpartition(":")
    return host.strip("[]"), int(port)


def supervisor_url(host: str, port: int, *, tls: bool) -> str:
    """Return the address of the REST interface and the page."""
    shown = f"[{host}]" if ":" in host else host
    return f"{'https' if tls else 'http'}://{shown}:{port}"
