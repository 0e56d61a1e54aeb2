"""Calls about access: who asks, and the audit log."""

from pincette.api.access_models import AuditList, Session
from pincette.client.call import Call, model


def session() -> Call[Session]:
    """Who asks, as the supervisor knows it."""
    return Call("GET", "/session", model(Session), repeatable=True)


def audit(limit: int, before: int | None) -> Call[AuditList]:
    """What was to change something, the newest first."""
    query: dict[str, str | float] = {"limit": limit}
    if before is not None:
        query["before"] = before
    return Call("GET", "/audit", model(AuditList), query, repeatable=True)
