"""What programs ask of the supervisor: probes, version, metrics, AsyncAPI, Thing Description."""

import asyncio
from time import monotonic
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client.exposition import choose_encoder

from pincette import __version__
from pincette.api.checks import Alive, Check, Readiness
from pincette.asyncapi.document import document
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.metrics import RigCollector
from pincette_supervisor.rest.dependencies import OBSERVE, AccessState, AllRigs
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.thing_description import THING_TYPE, WELL_KNOWN, thing
from pincette_supervisor.watch.checks import of_rig, of_supervisor, words_of

TURN_S = 1.0
"""The event loop is expected to come round at least this often."""
PLAIN = "text/plain"
EXAMPLE = 'pincette_trips_total{cause="command_age",rig="demo"} 0.0\n'


router = APIRouter(tags=["probes"], route_class=StrictRoute)
documents = APIRouter(tags=["documents"], route_class=StrictRoute)


@router.get("/livez")
async def livez() -> Alive:
    """Whether the event loop turns, and how long one turn of it takes."""
    begun_s = monotonic()
    await asyncio.sleep(0)
    turn_s = monotonic() - begun_s
    return Alive(checks=[_turn(turn_s)])


@router.get("/readyz", responses={503: {"model": Readiness, "description": "with the reasons"}})
def readyz(rigs: AllRigs, response: Response) -> Readiness:
    """Whether a rig is whole: all its programs answer and agree on the rig file.

    Of several rigs one is enough, so that one that is down takes the others from nobody; the
    reasons name it. A latched actuator is whole: it waits for a person.
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
            "description": "Prometheus' text format, or OpenMetrics where it is asked for",
        },
    },
    dependencies=[OBSERVE],
)
def metrics(
    rigs: AllRigs, accept: Annotated[str, Header(include_in_schema=False)] = ""
) -> Response:
    """Metrics of all rigs for Prometheus; no program is asked for them."""
    try:
        encode, kind = choose_encoder(accept)
    except (TypeError, ValueError):  # Accept names a version that is no number
        encode, kind = choose_encoder("")
    return Response(encode(RigCollector(rigs)), headers={"Content-Type": kind})


@router.get("/version")
async def version(rigs: AllRigs) -> dict[str, str | dict[str, str]]:
    """The program's version, its own rig, and the digest of the rig file of each it serves."""
    own = rigs.own
    return {
        "version": __version__,
        "rig": own.name,
        "rig_file_digest": own.context.digest,
        "rigs": {one.name: one.context.digest for one in rigs.all()},
    }


@documents.get("/asyncapi.json", response_model=dict[str, Any])
def asyncapi() -> Response:
    """Every key and message of the bus, as an AsyncAPI document."""
    return Response(document(), media_type="application/json")


@documents.get(WELL_KNOWN, include_in_schema=False)
async def thing_description(
    request: Request,
    rigs: AllRigs,
    access: AccessState,
    rig: Annotated[str | None, Query(max_length=200)] = None,
) -> JSONResponse:
    """The Thing Description of a rig; of the supervisor's own where none is named."""
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
