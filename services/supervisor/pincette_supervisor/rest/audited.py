"""Notes what was asked for, by whom, and how it was answered."""

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor.access.gate import Gate
from pincette_supervisor.access.trail import AuditTrail
from pincette_supervisor.journal.audit import AuditRow
from pincette_supervisor.journal.rows import utc_now
from pincette_supervisor.rest.boundary import SAFE_METHODS
from pincette_supervisor.rest.guard import NOTE, caller_of
from pincette_supervisor.rest.headers import label_of

LENGTH = 200
DRY_RUN = "dry run"
"""What moves nothing and keeps nothing is no action."""
REFUSED = (401, 403, 421)
"""For whose the request is, or by which name it came."""


class Audited:
    """Every request that was to change something, and every one refused for whose it was."""

    def __init__(self, app: ASGIApp, gate: Gate, trail: AuditTrail) -> None:
        self._app, self._gate, self._trail = app, gate, trail

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def noted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._note(scope, message)
            await send(message)

        await self._app(scope, receive, noted)

    def _note(self, scope: Scope, start: Message) -> None:
        status, said = int(start["status"]), str(scope.get(NOTE, ""))
        acts = scope["method"] not in SAFE_METHODS and said != DRY_RUN
        if not acts and status not in REFUSED:
            return
        caller = caller_of(scope, self._gate)
        made = Headers(raw=start.get("headers", [])).get("location", "").rpartition("/")[2]
        row = AuditRow(
            at=utc_now(),
            who=caller.signed(label_of(scope)),
            address=caller.address,
            action=f"{scope['method']} {scope['path']}"[:LENGTH],
            detail=f"{said} {made}".strip()[:LENGTH],
            status=status,
        )
        if status in REFUSED:
            self._trail.tell_refused(row)
        else:
            self._trail.tell(row)
