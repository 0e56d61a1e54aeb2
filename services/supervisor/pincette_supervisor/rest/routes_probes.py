"""Documents for other programs: probes, version, metrics, AsyncAPI, Thing Description.

The W3C Thing Description (1.1) of a rig is derived from the OpenAPI document.
"""

import asyncio
from collections.abc import Mapping, Sequence
from time import monotonic
from typing import Annotated, Any, cast
from urllib.parse import quote
from uuid import NAMESPACE_URL, uuid5

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client.exposition import choose_encoder

from pincette import __version__
from pincette.api.checks import Alive, Check, Readiness
from pincette.api.problems import MEDIA_TYPE
from pincette.asyncapi.document import document
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.metrics import RigCollector
from pincette_supervisor.rest.dependencies import OBSERVE, AccessState, AllRigs
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.watch import of_rig, of_supervisor, words_of

WELL_KNOWN = "/.well-known/wot"
THING_TYPE = "application/td+json"
CONTEXT = "https://www.w3.org/2022/wot/td/v1.1"
BINDING = {"htv": "http://www.w3.org/2011/http#"}
KEY, NO_KEY = "key", "none"
RIG, JOBS = "/api/v1/rigs/{rig}", "/api/v1/jobs"
PROPERTIES: Mapping[str, str] = {
    "state": RIG,
    "model": f"{RIG}/model",
    "timing": f"{RIG}/timing",
    "job": f"{JOBS}/{{job}}",
    "result": f"{JOBS}/{{job}}",
    "jobs": JOBS,
}
ACTIONS: Mapping[str, str] = {
    "plan": JOBS,
    "start": JOBS,
    "act": f"{JOBS}/{{job}}/actions",
    "stopRequest": f"{JOBS}/stop",
    "estop": f"{RIG}/estop",
}
"""Operations of the actions.

Reset is not among them, since it states that a person has checked the rig.
"""
EVENTS: Mapping[str, str] = {"live": f"{RIG}/live"}
"""Operations of the events. Job events are left out: their server-sent events have names, which a
form cannot request."""
DEEPEST = 1
"""Depth up to which nested models are included, so that a client can validate what it sends. Deeper
models are in the OpenAPI document.
"""
OPEN = ("estop",)
"""Operations whose security needs no key."""
FIXED = {"plan": "dry_run=true", "result": "wait=terminal&timeout_s=60"}
"""Queries that distinguish two affordances of one path."""
LEFT_OUT = ("discriminator", "example", "examples")
"""Schema keys that are left out, since only other tools use them."""


def thing(
    document: Mapping[str, Any],
    rig: str,
    base: str,
    *,
    keys: bool = False,
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Describe a rig, based on the OpenAPI document of its supervisor.

    ``base`` is the address of the supervisor; ``keys`` states whether it requires keys; ``others``
    are the other rigs that it serves.
    """
    described = _Described(document, rig)
    security = {KEY: {"scheme": "bearer", "in": "header"}, NO_KEY: {"scheme": "nosec"}}
    return {
        "@context": [CONTEXT, BINDING],
        "id": uuid5(NAMESPACE_URL, f"{base}{RIG.format(rig=rig)}").urn,
        "title": f"pincette {rig}",
        "description": document["info"]["description"],
        "version": {"instance": document["info"]["version"]},
        "base": f"{base}/",
        "securityDefinitions": security if keys else {NO_KEY: security[NO_KEY]},
        "security": KEY if keys else NO_KEY,
        "schemaDefinitions": {"problem": described.schema("Problem")},
        "properties": {name: described.property(name) for name in PROPERTIES},
        "actions": {
            name: described.action(name, keys=keys, several=bool(others)) for name in ACTIONS
        },
        "events": {name: described.event(name) for name in EVENTS},
        "links": [
            {"rel": "item", "href": f"{base}{WELL_KNOWN}?rig={quote(one)}", "type": THING_TYPE}
            for one in others
        ],
    }


class _Described:
    def __init__(self, document: Mapping[str, Any], rig: str) -> None:
        self._document, self._rig = document, rig

    def property(self, name: str) -> dict[str, Any]:
        """Return the affordance of a property, which can be read."""
        operation = self._operation(PROPERTIES[name], "get")
        form = self._form(name, PROPERTIES[name], "GET", "readproperty")
        told = self._answer(operation)
        return {**told, **self._words(operation), "readOnly": True, "forms": [form]}

    def action(self, name: str, *, keys: bool, several: bool) -> dict[str, Any]:
        """Return the affordance of an action; a plan moves nothing."""
        operation = self._operation(ACTIONS[name], "post")
        form = self._form(name, ACTIONS[name], "POST", "invokeaction")
        form["additionalResponses"] = [
            {"success": False, "contentType": MEDIA_TYPE, "schema": "problem"}
        ]
        found: dict[str, Any] = {**self._words(operation), "output": self._answer(operation)}
        body = operation.get("requestBody")
        if body is not None:
            found["input"] = self._inlined(body["content"]["application/json"]["schema"])
            self._name_rig(found["input"], wanted=several)
        if keys and name in OPEN:
            form["security"] = NO_KEY
        safe = name == "plan"
        return {**found, "safe": safe, "idempotent": safe or name in OPEN, "forms": [form]}

    def _name_rig(self, schema: dict[str, Any], *, wanted: bool) -> None:
        """Set ``rig`` in the request schema to this rig; require it if there are several rigs."""
        for one in schema.get("oneOf", [schema]):
            if "rig" not in one.get("properties", {}):
                continue
            one["properties"]["rig"] = {"type": "string", "const": self._rig}
            if wanted:
                one["required"] = sorted({*one.get("required", ()), "rig"})

    def event(self, name: str) -> dict[str, Any]:
        """Return the affordance of an event, which arrives as server-sent events."""
        operation = self._operation(EVENTS[name], "get")
        form = self._form(name, EVENTS[name], "GET", "subscribeevent")
        form["subprotocol"] = "sse"
        return {**self._words(operation), "data": self.schema("LiveBatch"), "forms": [form]}

    def schema(self, name: str) -> dict[str, Any]:
        """Return a model as a data schema that includes all models it refers to."""
        schemas = self._document["components"]["schemas"]
        return self._inlined(schemas[name]) if name in schemas else {"type": "object"}

    def _operation(self, path: str, method: str) -> dict[str, Any]:
        return self._document["paths"][path][method]

    def _words(self, operation: Mapping[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {"description": operation["description"].split("\n\n")[0]}
        named = [one for one in operation.get("parameters", ()) if one["in"] == "path"]
        variables = {
            one["name"]: self._inlined(one["schema"]) for one in named if one["name"] != "rig"
        }
        return {**found, "uriVariables": variables} if variables else found

    def _form(self, name: str, path: str, method: str, does: str) -> dict[str, Any]:
        href = path.replace("{rig}", self._rig).lstrip("/")
        query = f"?{FIXED[name]}" if name in FIXED else ""
        return {
            "href": href + query,
            "htv:methodName": method,
            "contentType": "application/json",
            "op": does,
        }

    def _answer(self, operation: Mapping[str, Any]) -> dict[str, Any]:
        answers = operation["responses"]
        good = next(answers[status] for status in sorted(answers) if "content" in answers[status])
        content = next(iter(good["content"].values()))
        found = self._inlined(content.get("schema", {}))
        return {"type": "object", **found}  # clients need the type of a union too

    def _inlined(self, node: Any, within: tuple[str, ...] = ()) -> Any:
        """Return a schema without references, since a data schema cannot have any."""
        if isinstance(node, list):
            return [self._inlined(one, within) for one in cast("list[Any]", node)]
        if not isinstance(node, dict):
            return node
        tree = cast("dict[str, Any]", node)
        name = str(tree.get("$ref", "")).rpartition("/")[2]
        if name:
            model = self._document["components"]["schemas"][name]
            if len(within) >= DEEPEST and model.get("type", "object") == "object":
                return {"type": "object"}
            return self._inlined(model, (*within, name))
        found = {
            key: self._inlined(value, within) for key, value in tree.items() if key not in LEFT_OUT
        }
        for union in {"anyOf", "oneOf"} & found.keys():
            # Models that have the same description after this would all match, and oneOf requires
            # exactly one match.
            found[union] = [
                one for at, one in enumerate(found[union]) if one not in found[union][:at]
            ]
        return found


TURN_S = 1.0
"""Longest permitted time between two turns of the event loop, in s."""
PLAIN = "text/plain"
EXAMPLE = 'pincette_trips_total{cause="command_age",rig="demo"} 0.0\n'


router = APIRouter(tags=["probes"], route_class=StrictRoute)
documents = APIRouter(tags=["documents"], route_class=StrictRoute)


@router.get("/livez")
async def livez() -> Alive:
    """Report whether the event loop runs, and how long one turn of it takes."""
    begun_s = monotonic()
    await asyncio.sleep(0)
    turn_s = monotonic() - begun_s
    return Alive(checks=[_turn(turn_s)])


@router.get("/readyz", responses={503: {"model": Readiness, "description": "with the reasons"}})
def readyz(rigs: AllRigs, response: Response) -> Readiness:
    """Report whether a rig is ready: all its programs reply and agree on the rig file.

    If there are several rigs, one ready rig is enough, so that a rig that is down does not make
    the others unavailable; the reasons name it. A rig with a latched actuator is ready: it waits
    for a person.
    """
    own = of_supervisor(rigs.store)
    found = dict(zip([one.name for one in rigs.all()], rigs.map(_looked_at), strict=True))
    missing = {rig: words_of(checks) for rig, checks in found.items()}
    reasons = [f"store: {words}" for words in words_of(own)]
    reasons += [f"{rig}: {words}" for rig, said in missing.items() for words in said]
    reasons += [f"{rig}: {why}" for rig, why in rigs.unusable.items()]
    whole = not words_of(own) and not all(missing.values())
    response.status_code = 200 if whole else 503
    status = "ready" if whole else "not ready"
    return Readiness(status=status, reasons=reasons, checks=own, rigs=found)


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        200: {
            "content": {PLAIN: {"schema": {"type": "string"}, "example": EXAMPLE}},
            "description": "Prometheus' text format, or OpenMetrics if requested",
        },
    },
    dependencies=[OBSERVE],
)
def metrics(
    rigs: AllRigs, accept: Annotated[str, Header(include_in_schema=False)] = ""
) -> Response:
    """Return the metrics of all rigs for Prometheus; no program is queried for them."""
    try:
        encode, kind = choose_encoder(accept)
    except (TypeError, ValueError):  # Accept contains a version that is not a number
        encode, kind = choose_encoder("")
    return Response(encode(RigCollector(rigs)), headers={"Content-Type": kind})


@router.get("/version")
async def version(rigs: AllRigs) -> dict[str, str | dict[str, str]]:
    """Return the program's version, its own rig, and the digests of the rig files it serves."""
    own = rigs.own
    return {
        "version": __version__,
        "rig": own.name,
        "rig_file_digest": own.context.digest,
        "rigs": {one.name: one.context.digest for one in rigs.all()},
    }


@documents.get("/asyncapi.json", response_model=dict[str, Any])
def asyncapi() -> Response:
    """Return every key and message of the bus, as an AsyncAPI document."""
    return Response(document(), media_type="application/json")


@documents.get(WELL_KNOWN, include_in_schema=False)
async def thing_description(
    request: Request,
    rigs: AllRigs,
    access: AccessState,
    rig: Annotated[str | None, Query(max_length=200)] = None,
) -> JSONResponse:
    """Return the Thing Description of a rig; by default of the supervisor's own."""
    name = rigs.own.name if rig is None else rigs.get(rig).name
    base = str(request.base_url).rstrip("/")
    others = [one.name for one in rigs.all() if one.name != name]
    keys = access.authenticator.keys_wanted
    found = thing(request.app.openapi(), name, base, keys=keys, others=others)
    return JSONResponse(found, media_type=THING_TYPE)


def _turn(turn_s: float) -> Check:
    words = f"one turn of the event loop took {1e3 * turn_s:.1f} ms"
    return Check(
        name="event_loop",
        ok=turn_s <= TURN_S,
        needed=True,
        value=turn_s,
        limit=TURN_S,
        unit="s",
        age_s=0.0,
        words=words,
    )


def _looked_at(manager: JobManager) -> list[Check]:
    manager.context.health.refresh()
    return of_rig(manager.context, manager.active)
