"""Who asks, pages that sign in, and the audit log."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from pincette.api.access_models import AuditEntry, AuditList, Session
from pincette.api.problem_models import responses
from pincette_supervisor.access.caller import Caller
from pincette_supervisor.access.gate import admit
from pincette_supervisor.access.secret import new_cookie
from pincette_supervisor.access.trail import AuditTrail
from pincette_supervisor.journal.audit import AuditBook
from pincette_supervisor.journal.keys import KeyBook
from pincette_supervisor.rest.guard import ADMIN, COOKIE, Known, gate_of
from pincette_supervisor.running.rigs import Rigs

LARGEST = 2**63 - 1


def routes(rigs: Rigs, trail: AuditTrail) -> APIRouter:
    """``/session`` and ``/audit``."""
    router = APIRouter(tags=["access"])

    @router.get("/session")
    async def session(request: Request, caller: Known) -> Session:  # pyright: ignore[reportUnusedFunction]
        """Who asks, and what they may do; told to everybody, so that a page can ask for a key."""
        return _view(caller, keys=gate_of(request).keys_wanted)

    @router.post("/session", responses=responses(401))
    async def sign_in(  # pyright: ignore[reportUnusedFunction]
        request: Request, response: Response, caller: Known
    ) -> Session:
        """Sign a page in with the key of ``Authorization``; a cookie stands for it from here on.

        Scripts cannot read the cookie, and no page of elsewhere can have it sent.
        """
        gate = gate_of(request)
        admit(caller, "observe")
        if caller.way == "key":
            cookie = new_cookie()
            await run_in_threadpool(gate.sign_in, KeyBook(rigs.store), caller, cookie)
            response.set_cookie(
                COOKIE,
                cookie,
                path="/",
                httponly=True,
                samesite="strict",
                secure=request.headers.get("origin", "").startswith("https://"),
            )
        return _view(caller, keys=gate.keys_wanted)

    @router.delete("/session")
    async def sign_out(request: Request, response: Response) -> Session:  # pyright: ignore[reportUnusedFunction]
        """Sign a page out."""
        gate, cookie = gate_of(request), request.cookies.get(COOKIE)
        if cookie is not None:
            await run_in_threadpool(gate.sign_out, KeyBook(rigs.store), cookie)
            response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
        return Session(keys=gate.keys_wanted, name=None, scope=None, signed_in=False)

    @router.get("/audit", dependencies=[ADMIN], responses=responses(422))
    def audit(  # pyright: ignore[reportUnusedFunction]
        limit: Annotated[int, Query(ge=1, le=500)] = 50,
        before: Annotated[
            int | None, Query(ge=1, le=LARGEST, description="entries below this number")
        ] = None,
    ) -> AuditList:
        """What was to change something, and what was refused for whose it was; the newest first."""
        book = AuditBook(rigs.store)
        trail.flush(book, everything=True)
        found = book.newest(limit + 1, before)
        entries = [
            AuditEntry(
                number=row.number or 0,
                at=row.at,
                who=row.who,
                address=row.address,
                action=row.action,
                detail=row.detail,
                status=row.status,
                count=row.count,
            )
            for row in found[:limit]
        ]
        return AuditList(entries=entries, next=entries[-1].number if len(found) > limit else None)

    return router


def _view(caller: Caller, *, keys: bool) -> Session:
    return Session(
        keys=keys, name=caller.name, scope=caller.scope, signed_in=caller.way == "session"
    )
