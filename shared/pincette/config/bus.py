"""Where the programs of a rig meet: its router, and those of others."""

from typing import Literal

from pydantic import Field, model_validator

from pincette.config.tables import Place, Table


class Bus(Table):
    """Where the programs listen: the router at ``port``, the others at the ports after it."""

    host: str = "127.0.0.1"
    """Address that the programs listen at, and are reached by."""
    port: int = Field(default=7447, ge=1024, le=65500)
    """The router's."""
    router: Place | None = None
    """HOST:PORT of another rig's router that this rig joins: it has no router of its own then, and
    is served by the supervisor at that one. None: its router is its own."""
    listen: str | None = Field(default=None, exclude=True)
    """Address on which the router listens, where others shall reach it than the programs at
    ``host``; 0.0.0.0: on all. None: on ``host``. It concerns the router's machine alone."""
    upstream: Place | None = None
    """HOST:PORT of a laboratory server's router, which the rig's own router connects to. None:
    there is none."""
    served_at: Literal["upstream", "rig"] = "upstream"
    """Beside which router supervisor, recorder and tools are, where there are two."""
    pki: str | None = Field(default=None, exclude=True)
    """Folder of certificates, relative to the rig file. None: no link is encrypted or closed to
    anybody. Where the folder is concerns this machine alone: it is told to nobody, recorded
    nowhere, and no part of the digest."""
    identity: str = Field(default="operator", exclude=True)
    """Whose certificate the tools of this machine show, where there are certificates."""

    @property
    def router_at(self) -> tuple[str, int]:
        """Host and port of the router, whosever it is."""
        return (self.host, self.port) if self.router is None else _at(self.router)

    @property
    def upstream_at(self) -> tuple[str, int] | None:
        """Host and port of the laboratory server's router; None where there is none."""
        return None if self.upstream is None else _at(self.upstream)

    @property
    def apart(self) -> bool:
        """Whether supervisor and recorder are beside another router than the loop."""
        return self.upstream is not None and self.served_at == "upstream"

    @property
    def served_by(self) -> tuple[str, int]:
        """Host and port of the router that supervisor, recorder and tools are beside."""
        above = self.upstream_at
        return self.router_at if above is None or not self.apart else above

    @model_validator(mode="after")
    def _one_way(self) -> "Bus":
        if self.upstream is not None and self.router is not None:
            raise ValueError(
                "router and upstream: a rig joins another router, or has one of its own that "
                "connects upstream; leave one of them out"
            )
        return self


def _at(place: str) -> tuple[str, int]:
    host, _, port = place.rpartition(":")
    return host.strip("[]"), int(port)
