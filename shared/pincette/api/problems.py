"""Problem documents, as described in the OpenAPI document."""

from collections.abc import Mapping
from typing import Any

from pydantic import ConfigDict

from pincette.api import Model

MEDIA_TYPE = "application/problem+json"
TYPE = "urn:pincette:problem:"
MEANINGS = {
    400: ("bad-json", "the body is not JSON, or names a member twice"),
    401: ("no-key", "a key is required, or the given key is not accepted (needed_scope)"),
    403: (
        "scope-too-small",
        "scope-too-small (with needed_scope, scope), or foreign-page: sent by a page of "
        "another site",
    ),
    404: ("not-found", "no such rig, job or artifact"),
    408: ("body-too-slow", "the body did not come in time"),
    409: (
        "job-active",
        "the state does not allow it: invalid-transition (with allowed_actions), job-active, "
        "part-held, nothing-held, queue-full, proposals-full, rig-claimed (with claim), "
        "estop-engaged, rig-latched (with cause), zero-not-confirmed (with job), "
        "reset-refused, model-changed, trajectory-stale, place-unknown (with sources), "
        "place-too-old (with value, limit, unit), "
        "recipe-limit, rig-is-real, simulation-refused, series-active (with series)",
    ),
    413: ("body-too-large", "the body is larger than a request may be"),
    415: ("unsupported-media-type", "the body is not declared as JSON (Content-Type)"),
    421: ("foreign-host", "the request was sent to a name that is not one of the supervisor's"),
    422: (
        "limit-violation",
        "invalid-request (with errors: pointer, message), limit-violation (with violations: "
        "pointer, quantity, value, limit, unit, at_s, message), calibration-unsupported (with "
        "needed_hz, bandwidth_hz, parts), impossible-model, no-prediction, "
        "simulation-impossible (with the operation), or idempotency-key-reused (with job)",
    ),
    429: ("too-many-requests", "the client sends requests too often (Retry-After)"),
    503: (
        "rig-not-ready",
        "rig-not-ready (with reasons), estop-unconfirmed, keys-unconfirmed, model-not-kept, "
        "store-failed, too-many-listeners, or busy: send the request again",
    ),
}


INSTANCE = "urn:uuid:0b5a4a2e-3f0f-4f0a-9a51-5a2f6c1f7f10"
REMEDIES: Mapping[str, str] = {
    "bad-json": "correct the body, and send the request again",
    "no-key": "send a key as `Authorization: Bearer KEY`; `pincette key add` makes one",
    "keys-unconfirmed": "see the supervisor's log; keep its data folder on a local disk",
    "scope-too-small": "use a key with the needed scope; `pincette key add --scope` makes one",
    "foreign-page": (
        "use the page of this supervisor, or send no Origin; behind a reverse proxy, make it "
        "pass on Host (nginx: proxy_set_header Host $http_host;)"
    ),
    "not-found": "use one of the listed names",
    "method-not-allowed": "use a method that the header Allow names",
    "body-too-slow": "send the request again, with its body at once",
    "body-too-large": "send less: a path of fewer points, shorter notes",
    "unsupported-media-type": "send `Content-Type: application/json`",
    "foreign-host": "use the supervisor's address, or add the name to [supervisor] names",
    "caller-gone": "send the request again, and wait for its answer",
    "invalid-transition": "request one of allowed_actions",
    "job-active": "wait for that job, stop it, or send the request with `queue`: true",
    "series-active": "wait for the end of that series, or stop it",
    "part-held": "release the part with a job `release`, or keep it with a job `hold`",
    "nothing-held": "grip a part first; `move` moves a free arm",
    "queue-full": "wait until a queued job has ended, or stop one",
    "proposals-full": "approve or reject the jobs that are proposed",
    "queue-moved": "read the queue again, then repeat the change",
    "estop-engaged": "make sure that the rig is safe, then reset it with `acknowledge`: true",
    "rig-latched": "make sure that the rig is safe, then reset it with `acknowledge`: true",
    "zero-not-confirmed": (
        "make sure that nothing touches the arm, then send `zero_confirmed`: true"
    ),
    "reset-refused": "correct what `detail` names, then reset again",
    "rig-claimed": (
        "ask the person who holds the claim, wait until it ends, or break it as an operator"
    ),
    "record-kept": "wait until the job has ended; unpin it before its record is deleted",
    "model-changed": "send the request again",
    "trajectory-stale": "create the trajectory again with the model in use",
    "place-unknown": "start the vision client, or state the place in the request",
    "place-too-old": "measure the place again just before the request, or permit more `max_age_s`",
    "recipe-limit": "use an existing recipe; no more can be added",
    "invalid-request": "correct what `errors` names, and send the request again",
    "limit-violation": "reduce the value at each pointer, or allow more time",
    "calibration-unsupported": "choose another calibration, or faster instruments",
    "impossible-model": "choose another version of the model",
    "no-prediction": "send the request with `predict=false`, or change the values",
    "rig-is-real": "make the change at the rig's bench",
    "simulation-refused": "set `scripts = true` in [simulation] of the rig file",
    "simulation-impossible": "take an operation and a value from the list of commands",
    "key-stopped": "use a new key for another request",
    "idempotency-key-reused": "use a new key for a new request",
    "too-many-requests": "wait as long as Retry-After says",
    "rig-not-ready": "correct what `reasons` names; `pincette doctor` reports more",
    "estop-unconfirmed": "run `pincette estop`, or switch off the power supply of the amplifier",
    "model-not-kept": "check free space and permissions of the disk, then send the request again",
    "store-failed": "check free space and permissions of the disk; `pincette doctor` reports more",
    "too-many-listeners": "close another page or stream",
    "busy": "send the request again in a moment",
    "internal-error": "look for `instance` in the supervisor's log, and report the fault",
}
"""Remedies by problem code."""


def remedy_of(code: str) -> str:
    """Return the remedy for a problem."""
    return REMEDIES.get(code, "see the detail")


class Problem(Model):
    """An error (RFC 9457): description, value, unit, limit, and remedy."""

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "examples": [
                {
                    "type": TYPE + "limit-violation",
                    "title": "The plan breaks a limit of the rig",
                    "status": 422,
                    "detail": "force 55.000 mN above the limit 40 mN, from 6.10 s (load)",
                    "remedy": REMEDIES["limit-violation"],
                    "instance": INSTANCE,
                    "violations": [
                        {
                            "pointer": "/force_mN",
                            "quantity": "force",
                            "side": "above",
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
    remedy: str
    """Action that can resolve the problem."""
    instance: str
    """Identifier of this response; the supervisor's log contains it too."""


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the problem documents with which a route may reply."""
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
                        "remedy": remedy_of(MEANINGS[status][0]),
                        "instance": INSTANCE,
                    },
                }
            },
        }
        for status in statuses
    }
