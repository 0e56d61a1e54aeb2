"""Sessions of pages, and the audit log, over REST."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from pincette.api.access import (
    AuditChain,
    AuditEntry,
    AuditList,
    PageCheck,
    Session,
    SignIn,
    Verdict,
)
from pincette.api.problems import remedy_of, responses
from pincette_supervisor.access.authentication import Caller, new_cookie, require_scope
from pincette_supervisor.journal.access import AuditRepository
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    ADMIN,
    CALLER,
    LARGEST,
    AccessState,
    AllRigs,
    AnyCaller,
    Journal,
    Note,
    PageSize,
    SupervisorId,
    delete_cookies,
    session_cookies,
    set_cookie,
)
from pincette_supervisor.rest.limits import ESTOP, MOST_BYTES
from pincette_supervisor.rest.middleware import DRY_RUN, PAGE_CHECK, refusal
from pincette_supervisor.rest.strict_route import StrictRoute

router = APIRouter(tags=["access"], route_class=StrictRoute)


@router.get("/session")
async def session(caller: AnyCaller, access: AccessState) -> Session:
    """Return the caller and its permissions.

    Accessible without a key, so that a page can ask for one.
    """
    return _view(caller, keys=access.authenticator.keys_wanted)


@router.post("/session", openapi_extra={MOST_BYTES: 4096})
async def sign_in(
    request: Request,
    response: Response,
    caller: AnyCaller,
    access: AccessState,
    store: Journal,
    note: Note,
    body: SignIn | None = None,
) -> Session:
    """Sign a page in with the key of ``Authorization``, or with a user's name and password.

    From then on, a cookie replaces the key.

    Scripts cannot read the cookie, and browsers do not send it for pages of other sites.
    """
    authenticator = access.authenticator
    if body is not None and authenticator.keys_wanted:
        note(f"as {body.user}")
        caller = await authenticator.by_password(caller, body.user, body.password)
        request.scope[CALLER] = caller
    require_scope(caller, "observe")
    if caller.way == "key":
        cookie = new_cookie()
        await run_in_threadpool(authenticator.sign_in, store, caller, cookie)
        set_cookie(response, request.scope, authenticator.supervisor, cookie)
    return _view(caller, keys=authenticator.keys_wanted)


@router.delete("/session")
async def sign_out(
    request: Request, response: Response, access: AccessState, store: Journal
) -> Session:
    """Sign a page out."""
    supervisor = access.authenticator.supervisor
    for cookie in session_cookies(request.scope, supervisor):
        await run_in_threadpool(access.authenticator.sign_out, store, cookie)
    delete_cookies(response, request.scope, supervisor)
    return Session(keys=access.authenticator.keys_wanted, name=None, scope=None, signed_in=False)


@router.post("/rigs/{rig}/page-check", responses=responses(404))
async def page_check(
    request: Request,
    rig: str,
    rigs: AllRigs,
    access: AccessState,
    caller: AnyCaller,
    supervisor: SupervisorId,
    note: Note,
) -> PageCheck:
    """Report whether a stop and a request of this page would be accepted, and if not, why.

    The checks are those of the emergency stop. Nothing moves, and no key is needed. Behind a
    reverse proxy, a page detects with this request that the proxy drops ``Host`` or forwards to
    another server.
    """
    note(DRY_RUN)
    if rig not in rigs.unusable:  # unusable rigs are stopped, too
        rigs.get(rig)
    scope = request.scope
    estop = scope["path"].removesuffix(PAGE_CHECK) + ESTOP
    return PageCheck(
        rig=rig,
        supervisor=supervisor,
        path=scope["path"],
        host=request.headers.get("host", ""),
        origin=request.headers.get("origin"),
        stop=_verdict(refusal(scope, access.names, estop)),
        order=_verdict(refusal(scope, access.names) or _scope_refusal(caller)),
    )


def _scope_refusal(caller: Caller) -> ProblemError | None:
    try:
        require_scope(caller, "operate")
    except ProblemError as error:
        return error
    return None


def _verdict(error: ProblemError | None) -> Verdict:
    if error is None:
        return Verdict(accepted=True, code=None, detail="", remedy="")
    remedy = remedy_of(error.code)
    return Verdict(accepted=False, code=error.code, detail=error.detail, remedy=remedy)


@router.get("/audit", dependencies=[ADMIN])
def audit(
    access: AccessState,
    store: Journal,
    limit: PageSize = 50,
    before: Annotated[
        int | None, Query(ge=1, le=LARGEST, description="entries below this number")
    ] = None,
) -> AuditList:
    """Return requests that could change something, and those rejected because of their sender.

    Newest first.
    """
    repository = AuditRepository(store)
    access.audit_buffer.flush(repository, everything=True)
    rows = repository.newest(limit + 1, before)
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
        for row in rows[:limit]
    ]
    return AuditList(entries=entries, next=entries[-1].number if len(rows) > limit else None)


@router.get("/audit/chain", dependencies=[ADMIN])
def audit_chain(
    access: AccessState,
    store: Journal,
    link: Annotated[
        str | None, Query(pattern="^[0-9a-f]{64}$", description="`newest` of an earlier reply")
    ] = None,
) -> AuditChain:
    """Check whether each entry of the audit log follows from the previous one."""
    repository = AuditRepository(store)
    access.audit_buffer.flush(repository, everything=True)
    chain = repository.chain(link or "")
    return AuditChain(
        entries=chain.entries,
        first=chain.first,
        newest=None if chain.newest is None else chain.newest.number,
        link=None if chain.newest is None else chain.newest.link,
        broken=chain.broken,
        found=None if link is None else chain.found,
    )


def _view(caller: Caller, *, keys: bool) -> Session:
    return Session(
        keys=keys, name=caller.name, scope=caller.scope, signed_in=caller.way == "session"
    )
