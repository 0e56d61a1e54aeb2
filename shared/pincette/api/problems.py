"""Problem documents as the OpenAPI document shows them."""

from collections.abc import Mapping
from typing import Any

from pydantic import ConfigDict

from pincette.api import Model

MEDIA_TYPE = "application/problem+json"
TYPE = "urn:pincette:problem:"
MEANINGS = {
    400: ("bad-json", "the body is not JSON, or names a member twice"),
    401: ("no-key", "a key is required, or the one sent is not accepted (needed_scope)"),
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
        "part-held, nothing-held, queue-full, rig-claimed (with claim), estop-engaged, "
        "rig-latched (with cause), zero-not-confirmed (with job), reset-refused, model-changed, "
        "trajectory-stale, recipe-limit, rig-is-real, simulation-refused",
    ),
    413: ("body-too-large", "the body is larger than a request may be"),
    415: ("unsupported-media-type", "the body is not declared as JSON (Content-Type)"),
    421: ("foreign-host", "the supervisor is asked by a name that is none of its own"),
    422: (
        "limit-violation",
        "invalid-request (with errors: pointer, message), limit-violation (with violations: "
        "pointer, quantity, value, limit, unit, at_s, message), calibration-unsupported (with "
        "needed_hz, bandwidth_hz, parts), impossible-model, no-prediction, "
        "simulation-impossible (with the operation), or idempotency-key-reused (with job)",
    ),
    429: ("too-many-requests", "the client asks too often (Retry-After)"),
    503: (
        "rig-not-ready",
        "rig-not-ready (with reasons), estop-unconfirmed, keys-unconfirmed, model-not-kept, "
        "store-failed, too-many-listeners, or busy: ask again",
    ),
}


INSTANCE = "urn:uuid:0b5a4a2e-3f0f-4f0a-9a51-5a2f6c1f7f10"
REMEDIES: Mapping[str, str] = {
    "bad-json": "mend the body, and send it again",
    "no-key": "send a key as `Authorization: Bearer KEY`; `pincette key add` makes one",
    "keys-unconfirmed": "see the supervisor's log; keep its data folder on a local disk",
    "scope-too-small": "use a key with the needed scope; `pincette key add --scope` makes one",
    "foreign-page": "use the page of this supervisor, or send no Origin; behind a reverse proxy, "
    "let it pass on Host (nginx: proxy_set_header Host $http_host;)",
    "not-found": "take a name from the list of what there is",
    "method-not-allowed": "use a method that the header Allow names",
    "body-too-slow": "send the request again, its body at once",
    "body-too-large": "send less: a path of fewer points, shorter notes",
    "unsupported-media-type": "send `Content-Type: application/json`",
    "foreign-host": "use the supervisor's address, or add the name to [supervisor] names",
    "caller-gone": "send the request again, and wait for its answer",
    "invalid-transition": "ask for one of allowed_actions",
    "job-active": "wait for that job, stop it, or send the request with `queue`: true",
    "part-held": "release the part by a job `release`, or keep it by a job `hold`",
    "nothing-held": "grip a part first; `move` brings a free arm to another place",
    "queue-full": "wait until a queued job has ended, or stop one",
    "queue-moved": "read the queue again, then repeat the change",
    "estop-engaged": "see that the rig is safe, then reset it with `acknowledge`: true",
    "rig-latched": "see that the rig is safe, then reset it with `acknowledge`: true",
    "zero-not-confirmed": "see that nothing touches the arm, then send `zero_confirmed`: true",
    "reset-refused": "mend what the detail names, then reset again",
    "rig-claimed": "ask its holder, wait until the claim ends, or break it as an operator",
    "record-kept": "wait until the job has ended; unpin it before its record is deleted",
    "model-changed": "send the request again",
    "trajectory-stale": "make the trajectory anew with the model in use",
    "recipe-limit": "use a recipe that is there; none can be added",
    "invalid-request": "mend what errors name, and send it again",
    "limit-violation": "ask for less of what each pointer names, or for more time",
    "calibration-unsupported": "choose another calibration, or faster instruments",
    "impossible-model": "choose another version of the model",
    "no-prediction": "send it with `predict=false`, or change the values",
    "rig-is-real": "make the change at the rig's bench",
    "simulation-refused": "set `scripts = true` in [simulation] of the rig file",
    "simulation-impossible": "take an operation and a value from the list of commands",
    "key-stopped": "use a new key for another request",
    "idempotency-key-reused": "use a new key for a new request",
    "too-many-requests": "wait as long as Retry-After says",
    "rig-not-ready": "mend what reasons name; `pincette doctor` says more",
    "estop-unconfirmed": "run `pincette estop`, or switch the amplifier's supply off",
    "model-not-kept": "look at the disk's room and rights, then send it again",
    "store-failed": "look at the disk's room and rights; `pincette doctor` says more",
    "too-many-listeners": "close another page or stream",
    "busy": "ask again in a moment",
    "internal-error": "look into the supervisor's log for the instance, and report it",
}
"""Remedy for each problem, by its code."""


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
    """Identifier of this response, which is also in the supervisor's log."""


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the problem documents that a route may answer with."""
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
