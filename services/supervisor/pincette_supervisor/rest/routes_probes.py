"""Two probes that ask two questions: whether the supervisor is alive, and whether it can serve."""

import asyncio
from time import monotonic

from fastapi import APIRouter, Response

from pincette.api.check_models import Alive, Check, Readiness
from pincette_supervisor.running.checks import of_rig, of_supervisor, words_of
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.rigs import Rigs

TURN_S = 1.0
"""The event loop is expected to come round at least this often."""


def routes(rigs: Rigs) -> APIRouter:
    """``/livez`` and ``/readyz``."""
    router = APIRouter(tags=["probes"])

    @router.get("/livez")
    async def livez() -> Alive:  # pyright: ignore[reportUnusedFunction]
        """Whether the event loop turns, and how long one turn of it takes."""
        begun_s = monotonic()
        await asyncio.sleep(0)
        turn_s = monotonic() - begun_s
        return Alive(checks=[_turn(turn_s)])

    @router.get("/readyz", responses={503: {"model": Readiness, "description": "with the reasons"}})
    def readyz(response: Response) -> Readiness:  # pyright: ignore[reportUnusedFunction]
        """Whether a rig is whole: all its programs answer and agree on the rig file.

        Of several rigs one is enough, so that one that is down takes the others from nobody; the
        reasons name it. A latched actuator is whole: it waits for a person.
        """
        own = of_supervisor(rigs.store)
        found = dict(zip([one.name for one in rigs.all()], rigs.of_all(_looked_at), strict=True))
        missing = {rig: words_of(checks) for rig, checks in found.items()}
        reasons = [f"store: {words}" for words in words_of(own)]
        reasons += [f"{rig}: {words}" for rig, said in missing.items() for words in said]
        reasons += [f"{rig}: {why}" for rig, why in rigs.unusable.items()]
        whole = not words_of(own) and not all(missing.values())
        response.status_code = 200 if whole else 503
        status = "ready" if whole else "not ready"
        return Readiness(status=status, reasons=reasons, checks=own, rigs=found)

    return router


def _turn(turn_s: float) -> Check:
    words = f"the event loop took {1e3 * turn_s:.1f} ms to come round"
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


def _looked_at(conductor: Conductor) -> list[Check]:
    conductor.site.health.refresh()
    return of_rig(conductor.site, conductor.active)
