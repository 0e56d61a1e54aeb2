"""Common parts of the tools: session and trace of a call, and its errors."""

from collections.abc import Generator
from contextlib import contextmanager

from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ToolError

from pincette.client import ClientError, JobEndedError
from pincette_mcp.plans import NoPlanError

SESSION = "mcp-session-id"
"""Name of the header that identifies a session; the newest revision of the protocol has no
sessions.
"""
TRACE = "traceparent"
"""Key of the W3C trace context in ``_meta`` of a call."""


@contextmanager
def tool_errors() -> Generator[None]:
    """Turn rejected requests and failed jobs into tool errors with their codes."""
    try:
        yield
    except JobEndedError as error:
        outcome = f" ({error.outcome})" if error.outcome else ""
        raise ToolError(f"{error.code}{outcome}: {error}") from error
    except ClientError as error:
        raise ToolError(f"{error.code}: {error}") from error
    except NoPlanError as error:
        raise ToolError(str(error)) from error


def session_of(context: Context) -> str:
    """Return the session of a request; empty over stdio, and if the protocol has none."""
    request = context.request_context.request
    return "" if request is None else request.headers.get(SESSION, "")


def traced(context: Context) -> str | None:
    """Return the trace context of a call; None without one."""
    found = (context.request_context.meta or {}).get(TRACE)
    return found if isinstance(found, str) else None
