"""The programs of a rig: their addresses, supervisor and recorder, and real-time settings."""

from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Literal, cast
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from pincette.config.addresses import BusAddresses, supervisor_url
from pincette.config.notify import Mail, Webhook
from pincette.config.tables import NotNegative, Positive, Table


def _place(text: str) -> str:
    """Validate the address of a program as HOST:PORT."""
    try:
        parts = urlsplit(f"//{text}")
        if parts.hostname and parts.port and parts.netloc == text:
            return text
    except ValueError:
        pass
    raise ValueError("expected HOST:PORT with a port from 1 to 65535")


Place = Annotated[str, AfterValidator(_place)]


class Bus(BusAddresses, Table):
    """Addresses of the programs: the router has the port ``port``, the others the ports after
    it.
    """

    host: str = "127.0.0.1"
    """Address at which the programs listen and can be reached."""
    port: int = Field(default=7447, ge=1024, le=65500)
    """Port of the router."""
    router: Place | None = None
    """HOST:PORT of another rig's router that this rig joins. The rig then has no router of its own,
    and the supervisor there serves it. None: the rig has its own router."""
    listen: str | None = Field(default=None, exclude=True)
    """Address on which the router listens, if programs on other addresses than ``host`` must reach
    it; 0.0.0.0: all addresses. None: ``host``. The value is used only on the router's machine.
    """
    upstream: Place | None = None
    """HOST:PORT of a laboratory server's router, to which the rig's own router connects. None:
    there is no such router."""
    served_at: Literal["upstream", "rig"] = "upstream"
    """Router that supervisor, recorder and tools use, if there are two."""
    pki: str | None = Field(default=None, exclude=True)
    """Folder of certificates, relative to the rig file. None: links are not encrypted and not
    access-controlled. The path is valid only on this machine: it is not sent, not recorded, and not
    part of the digest.
    """
    identity: str = Field(default="operator", exclude=True)
    """Name of the certificate that the tools of this machine use, if there are certificates."""

    @model_validator(mode="after")
    def _one_way(self) -> "Bus":
        if self.upstream is not None and self.router is not None:
            raise ValueError(
                "router and upstream exclude each other: a rig joins another router, or has "
                "its own, which connects upstream"
            )
        return self


class Recorder(Table):
    """Conditions under which a record is refused, closed or deleted."""

    min_free_MB: NotNegative = 200.0
    """Free disk space below which no record is started, and therefore no job."""
    silence_s: float = Field(default=10.0, ge=1.0)
    """Time without samples after which a record is closed as incomplete."""
    keep_days: Positive | None = None
    """Age after which records are deleted; None: records are not deleted because of their age."""
    keep_GB: Positive | None = None
    """Total size above which the oldest records are deleted; None: records are not deleted because
    of their size.
    """


HostName = Annotated[str, Field(pattern=r"^[A-Za-z0-9]([A-Za-z0-9.-]{0,252})$")]


Behind = Literal["nothing", "container"]
"""Protection of a port from other machines, in addition to that of the program itself."""
CAMERA = r"^https?://[A-Za-z0-9.\-\[\]:]{1,255}(/[!#-%(-:=?-_a-z~]{0,1000})?$"
"""Pattern of a camera's address. It excludes characters that end an attribute in the page or an
entry of its security policy.
"""


class Supervisor(Table):
    """Address of the supervisor, and access to it."""

    host: str = "127.0.0.1"
    """Address at which the supervisor listens. If it is not a loopback address, the supervisor
    starts only if keys exist.
    """
    port: int = Field(default=8000, ge=1, le=65535)
    """Port of the REST interface and the page."""
    tls: bool = False
    """True serves REST and page over TLS, ``https://``, with the supervisor's certificate in
    ``[bus] pki``."""
    names: tuple[HostName, ...] = Field(default=(), max_length=20, strict=False)
    """Names under which clients reach the supervisor, besides its address; requests with any other
    name are refused.
    """
    behind: Behind = "nothing"
    """``container``: you ensure that the port is published only on the loopback of the host. The
    supervisor may then listen on every address of its container without keys."""
    keys: Literal["once_made", "always"] = "once_made"
    """Determines when keys are required. ``once_made``: as soon as ``pincette key add`` has created
    one. ``always``: even before that, and also if the data folder has been lost.
    """
    clients_per_address: int = Field(default=1, ge=1, le=256)
    """Number of clients without a key behind one address, for example behind a reverse proxy. The
    limits for an address (request rate, simultaneous requests, streams) are multiplied by it. Each
    key has separate limits; the limits for all clients together do not change.
    """
    webhooks: tuple[Webhook, ...] = Field(default=(), max_length=10, strict=False)
    """Webhooks that are notified of ended jobs and of alarms."""
    camera: Annotated[str, Field(pattern=CAMERA)] | None = None
    """Address of a camera's MJPEG stream, such as http://bench-camera:8081/stream, which the page
    shows beside the charts. The browser fetches it directly, so it must not require a user or
    password. The supervisor adds its pictures at contact, hold and end of a job to the record.
    """
    mail: Mail | None = None
    """Mail server and recipients for notifications of ended jobs and alarms; None: no mails."""

    @property
    def url(self) -> str:
        """Return the address of the REST interface and the page."""
        return supervisor_url(self.host, self.port, tls=self.tls)


class Sila(Table):
    """Address of the SiLA 2 server, and access to it."""

    host: str = "127.0.0.1"
    """Address at which the server listens. If it is not a loopback address, the server starts only
    with a certificate and with ``login``.
    """
    port: int = Field(default=50052, ge=1, le=65535)
    """Port of the server; the default is that of SiLA's own examples."""
    certificate: str | None = None
    """File of the server's certificate (PEM), relative to the rig file; the private key is in the
    file of the same name that ends with .key. None: no TLS."""
    discovery: bool = False
    """True announces the server in the local network by mDNS."""
    login: bool = False
    """True if motions require a login with a key of the supervisor."""
    supervisor: str | None = None
    """Address of the supervisor, such as http://bench:8000. None: from ``[supervisor]``."""
    behind: Behind = "nothing"
    """``container``: as in ``[supervisor]``; the server may then listen on every address of its
    container without a certificate."""

    @model_validator(mode="after")
    def _secure(self) -> "Sila":
        if self.behind != "nothing":
            return self
        require_certificate(self.host, self.certificate, "others could move the arm")
        if not (self.login or _is_loopback(self.host)):
            raise ValueError(
                f"host = {self.host!r} without a login: anyone who can reach it could move "
                "the arm with this server's own key; state `login = true`, or listen on "
                "127.0.0.1"
            )
        return self


Origin = Annotated[
    str, Field(pattern=r"^([a-z][a-z0-9+.-]*://[A-Za-z0-9.\-\[\]:]{1,255}|file://)$")
]
VIEWERS = ("https://app.foxglove.dev", "file://")
"""Default origins. A page that was opened from a file has the origin ``file://`` or ``null``."""


class Foxglove(Table):
    """Address of the Foxglove WebSocket server, and access to it."""

    host: str = "127.0.0.1"
    """Address at which the server listens. If it is not a loopback address, the server starts only
    with a certificate.
    """
    port: int = Field(default=8765, ge=1, le=65535)
    """Port of the server; the default is the one that viewers suggest."""
    certificate: str | None = None
    """File of the server's certificate (PEM), relative to the rig file; the private key is in the
    file of the same name that ends with .key. None: no TLS."""
    supervisor: str | None = None
    """Address of the supervisor, which performs emergency stops. None: from ``[supervisor]``."""
    origins: tuple[Origin, ...] = Field(default=VIEWERS, max_length=20, strict=False)
    """Web pages that may connect, such as https://viewer.example, in addition to those that this
    machine serves. The default allows Foxglove's pages, and programs that load their pages from
    files, such as its desktop program; a program that is not a web page sends no origin and may
    connect.
    """
    behind: Behind = "nothing"
    """``container``: as in ``[supervisor]``; the server may then listen on every address of its
    container without a certificate."""

    @model_validator(mode="after")
    def _secure(self) -> "Foxglove":
        if self.behind == "nothing":
            why = "others could read along and stop the rig"
            require_certificate(self.host, self.certificate, why)
        return self


def require_certificate(host: str, certificate: str | None, why: str) -> None:
    """Raise ValueError if a server can be reached from other machines and has no certificate."""
    if certificate is None and not _is_loopback(host):
        raise ValueError(
            f"host = {host!r} without a certificate: {why}; state `certificate`, or listen on "
            "127.0.0.1"
        )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


Ticking = Literal["router", "rig", "sensor", "estimator", "controller", "actuator"]
"""Programs that take part in every tick."""
SchedulingSetting = Literal["priority", "cores", "timer_slack", "cpu_latency", "memory"]
PRIORITY = 10
"""Default priority: above all tasks with the normal scheduling policy, below the kernel's
threads.
"""
Priority = Annotated[int, Field(ge=0, le=99)]
Core = Annotated[int, Field(ge=0, le=1023)]
Cores = Annotated[tuple[Core, ...], Field(max_length=1024, strict=False)]


@dataclass(frozen=True, slots=True)
class Scheduling:
    """Scheduling settings of one program."""

    priority: int = PRIORITY
    """Priority under SCHED_FIFO; 0: no fixed priority."""
    cores: tuple[int, ...] = ()
    """Processors on which the program runs; empty: all."""
    timer_slack_s: float = 1e-6
    """Timer slack; 0 s: the system's setting."""
    cpu_latency_s: float | None = None
    """Limit of the processors' wake-up time; None: the system's setting."""
    lock_memory: bool = False
    required: frozenset[SchedulingSetting] = frozenset()


class RealTime(Table):
    """Real-time settings of the periodic programs, for all of them or for each program.

    They change no result and may differ between machines.
    """

    priority: Priority | dict[Ticking, Priority] = PRIORITY
    """Fixed priority (SCHED_FIFO), above all programs without one; 0: no fixed priority is
    requested. In a table by program, a program that is not named requests the default."""
    cores: Cores | dict[Ticking, Cores] = ()
    """Processors on which the programs run, counted from 0; empty: any."""
    timer_slack_s: float = Field(default=1e-6, ge=0.0, le=1.0)
    """Time for which the kernel may delay a wake-up of a program without a fixed priority, to
    combine it with others; the Linux default is 50 µs. 0: the system's setting."""
    cpu_latency_s: float | None = Field(default=None, ge=0.0, le=1.0)
    """Longest time that any processor may take to wake from idling while the program runs; with 0
    no processor sleeps, and all need full power. None: the system's setting.
    """
    lock_memory: bool = False
    """True prevents the system from swapping out the memory of the programs."""
    computing_s: float = Field(default=0.002, gt=0.0, le=1.0)
    """Time that programs and bus need from sample to command, without the instruments:
    two samples on the bus and four steps, with a margin for slow ones."""
    required: tuple[SchedulingSetting, ...] = Field(default=(), strict=False)
    """Settings that the system must permit for the program to start; the others are optional."""

    def of(self, *programs: str) -> Scheduling:
        """Return the settings of a program.

        A program that runs several services gets the highest of their priorities and all their
        processors.
        """
        names = cast(tuple[Ticking, ...], programs)
        priority, cores = self.priority, self.cores
        each = [cores.get(name, ()) if isinstance(cores, dict) else cores for name in names]
        return Scheduling(
            priority=max(priority.get(name, PRIORITY) for name in names)
            if isinstance(priority, dict)
            else priority,
            cores=tuple(sorted({core for some in each for core in some})) if all(each) else (),
            timer_slack_s=self.timer_slack_s,
            cpu_latency_s=self.cpu_latency_s,
            lock_memory=self.lock_memory,
            required=frozenset(self.required),
        )
