"""Problem documents as the OpenAPI document shows them."""

from typing import Any

from pydantic import ConfigDict

from pincette.api import Model

MEDIA_TYPE = "application/problem+json"
TYPE = "urn:pincette:problem:"
MEANINGS = {
    400: ("bad-json", "the body is not JSON, or names a member twice"),
    401: ("no-key", "a key is wanted, or what was shown opens nothing (needed_scope)"),
    403: (
        "scope-too-small",
        "scope-too-small (with needed_scope, scope), or foreign-page: sent by a page of elsewhere",
    ),
    404: ("not-found", "no such rig, job or artifact"),
    408: ("body-too-slow", "the body did not come in time"),
    409: (
        "job-active",
        "the state does not allow it: invalid-transition (with allowed_actions), job-active, "
        "part-held, queue-full, estop-engaged, rig-latched (with cause), reset-refused, "
        "model-changed, trajectory-stale, recipe-limit",
    ),
    413: ("body-too-large", "the body is larger than a request may be"),
    415: ("unsupported-media-type", "the body is not declared as JSON (Content-Type)"),
    421: ("foreign-host", "the supervisor is asked by a name that is none of its own"),
    422: (
        "limit-violation",
        "invalid-request (with errors: pointer, message), limit-violation (with violations: "
        "pointer, quantity, value, limit, unit, at_s, message), calibration-unsupported (with "
        "needed_hz, bandwidth_hz, parts), impossible-model, no-prediction, or "
        "idempotency-key-reused (with job)",
    ),
    429: ("too-many-requests", "the client asks too often (Retry-After)"),
    503: (
        "rig-not-ready",
        "rig-not-ready (with reasons), estop-unconfirmed, model-not-kept, store-failed, "
        "too-many-listeners, or busy: ask again",
    ),
}


class Problem(Model):
    """An error (RFC 9457): what, value, unit, limit, and what to do."""

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "examples": [
                {
                    "type": TYPE + "limit-violation",
                    "title": "The plan breaks a limit of the rig",
                    "status": 422,
                    "detail": "force 55.000 mN above the limit 40 mN, from 6.10 s (load)",
                    "violations": [
                        {
                            "pointer": "/force_mN",
                            "quantity": "force",
                            "value": 55.0,
                            "limit": 40.0,
                            "unit": "mN",
                            "at_s": 6.1,
                            "message": "force 55.000 mN above the limit 40 mN, from 6.10 s (load)",
                        }
                    ],
                }
            ]
        },
    )

    type: str
    title: str
    status: int
    detail: str


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Problem documents a route may answer with."""
    reference = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {
            "description": MEANINGS[status][1],
            "content": {
                MEDIA_TYPE: {
                    "schema": reference,
                    "example": {
                        "type": TYPE + MEANINGS[status][0],
                        "title": "…",
                        "status": status,
                        "detail": "…",
                    },
                }
            },
        }
        for status in statuses
    }
