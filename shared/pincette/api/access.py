"""Access over REST: scopes, sessions, keys, and the audit log."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import Model, example

Scope = Literal["observe", "propose", "operate", "admin"]
SCOPES: tuple[Scope, ...] = ("observe", "propose", "operate", "admin")
"""Scopes in ascending order; each includes those before it. They permit to read and stop; to plan;
to move the rig; to change it for all clients.
"""
MEANINGS: dict[Scope, str] = {
    "observe": "see everything",
    "propose": "also plan jobs, and propose them for approval",
    "operate": "also approve, run and act on jobs, store recipes, reorder the queue, reset",
    "admin": "also decide which model is in use, and read the audit log",
}
KEY_NAME = r"[a-z0-9][a-z0-9._-]{0,39}"
"""Pattern of a key's name. It excludes blanks and brackets, so that text after the name cannot be
mistaken for part of it.
"""


def covers(has: Scope, needed: Scope) -> bool:
    """Return whether a scope includes another one."""
    return SCOPES.index(has) >= SCOPES.index(needed)


class Session(Model):
    """Identity and permissions of the caller of a request, as determined by the supervisor."""

    model_config = example(keys=True, name="cell-7", scope="operate", signed_in=False)

    keys: bool
    """True if the supervisor requires a key. Without keys, every client that reaches the supervisor
    may do everything."""
    name: str | None
    """Name of the key or the user; null if the caller has none."""
    scope: Scope | None
    """Scope of the caller; null if it has none."""
    signed_in: bool
    """True if the request contained the key as the session cookie of a page."""


class SignIn(Model):
    """Sign-in by name and password, without a key."""

    model_config = example(user="ann", password="correct horse battery")

    user: str = Field(max_length=40)
    password: str = Field(max_length=200)


class Verdict(Model):
    """Verdict on a request: accepted, or the reason why it would be rejected."""

    model_config = example(accepted=True, code=None, detail="", remedy="")

    accepted: bool
    code: str | None
    """Code of the problem with which the request would be rejected; null if it would be accepted.
    """
    detail: str
    remedy: str


class PageCheck(Model):
    """Origin and path of a page's request, as the supervisor received them, and the permissions of
    the page.
    """

    model_config = example(
        rig="demo",
        supervisor="3f9c0a51b2d47e68",
        path="/api/v1/rigs/demo/page-check",
        host="gripper.lab:8000",
        origin="http://gripper.lab:8000",
        stop={"accepted": True, "code": None, "detail": "", "remedy": ""},
        order={"accepted": True, "code": None, "detail": "", "remedy": ""},
    )

    rig: str
    supervisor: str
    """Identifier of the supervisor. It is stored in the journal and does not change while that
    exists.
    """
    path: str
    """Path of the request as the supervisor received it."""
    host: str
    """Header ``Host`` as the supervisor received it; empty without one."""
    origin: str | None
    """Header ``Origin`` as the supervisor received it; null without one."""
    stop: Verdict
    """Verdict on an emergency stop from this page."""
    order: Verdict
    """Verdict on a request from this page that needs the scope `operate`."""


class AuditEntry(Model):
    """One request for a change, or one request that was rejected because of its caller."""

    model_config = example(
        number=12,
        at="2026-03-01T12:00:09.250Z",
        who="cell-7 (Ann)",
        address="192.168.1.20",
        action="POST /api/v1/jobs/20260301-120000-1f0c/actions",
        detail="stop",
        status=202,
        count=1,
    )

    number: int
    at: str
    who: str
    """Name of the key, followed by the caller's label in brackets; without a key, the label or the
    address.
    """
    address: str
    action: str
    detail: str
    """Requested change and its outcome, in one or two words."""
    status: int
    """HTTP status of the response."""
    count: int
    """Number of identical requests that were rejected within a short time."""


class AuditList(Model):
    """The audit log, newest entry first."""

    model_config = example(entries=[], next=None)

    entries: list[AuditEntry]
    next: int | None = None
    """Value of ``before`` for the next page; null at the end."""


class AuditChain(Model):
    """Result of checking the hash chain of the audit log: each entry contains the hash of the one
    before it.
    """

    model_config = example(entries=0, first=None, newest=None, link=None, broken=None, found=None)

    entries: int
    first: int | None
    """Number of the oldest entry that is kept; null if there is none."""
    newest: int | None
    link: str | None
    """SHA-256 of the newest entry. Keep a copy elsewhere, to check later that the log still
    contains it.
    """
    broken: int | None
    """Number of the first entry that was changed, or that follows a missing entry; null if there is
    none.
    """
    found: bool | None
    """True if the requested link is in the log; null if none was requested."""


class KeyView(Model):
    """Description of a key, without its secret."""

    model_config = example(
        name="cell-7",
        scope="operate",
        made_at="2026-03-01T12:00:00.000Z",
        expires_at=None,
        revoked_at=None,
        used_at="2026-03-01T12:00:09.250Z",
        usable=True,
    )

    name: str
    scope: Scope
    made_at: str
    expires_at: str | None
    revoked_at: str | None
    used_at: str | None
    """Time of the last use, to the minute; null if the key was never used."""
    usable: bool


class Claim(Model):
    """Claim of a client on a rig. While it lasts, other clients cannot start a job; every client
    can stop.
    """

    model_config = example(
        by="cell-7",
        note="night run",
        since="2026-03-01T12:00:00.000Z",
        expires_at="2026-03-01T12:01:00.000Z",
        left_s=41.5,
    )

    by: str
    """Name of the client that holds the claim, in the form of a job's ``by``."""
    note: str
    since: str
    expires_at: str
    left_s: float
    """Time until the claim expires."""


class ClaimRequest(Model):
    """Request to claim a rig for a limited time; repeating it renews the claim."""

    model_config = example(lease_s=60.0, note="night run")

    lease_s: Annotated[float, Field(ge=1.0, le=3600.0)] = 60.0
    """Time after which the claim ends unless it is renewed."""
    note: str = Field(default="", max_length=200)
