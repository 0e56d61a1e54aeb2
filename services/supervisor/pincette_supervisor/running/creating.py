"""A job as it is first kept, and what tells two requests apart."""

import hashlib
import json
import secrets
from datetime import UTC, datetime

from pincette.api.request_models import AnyJobRequest
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.planning.planned import Planned


def new_row(request: AnyJobRequest, planned: Planned, rig: str, by: str | None) -> JobRow:
    """A job of a request and of whoever made it, named by the time and by chance."""
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    return JobRow(
        id=f"{stamp}-{secrets.token_hex(3)}",
        kind=request.kind,
        rig=rig,
        state="queued",
        request=request.model_dump(mode="json", exclude_unset=True),
        plan={**planned.plan.model_dump(mode="json"), "values": planned.values},
        created_at=utc_now(),
        requested_by=by,
    )


def fingerprint_of(request: AnyJobRequest) -> str:
    """Equal for requests that say the same."""
    tree = request.model_dump(mode="json", exclude_unset=True)
    text = json.dumps({**tree, "kind": request.kind}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
