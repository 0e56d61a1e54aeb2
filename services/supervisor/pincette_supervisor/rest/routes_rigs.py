"""Rigs over REST, and the emergency stop."""

import asyncio

from fastapi import APIRouter, Request

from pincette.api.problem_models import responses
from pincette.api.proposal_models import ModelAction, ModelView
from pincette.api.rig_models import (
    QueueRequest,
    ResetRequest,
    Rig,
    RigList,
    Stopped,
    StoppedList,
)
from pincette.api.timing_models import LoopTiming
from pincette_supervisor.model.model_view import model_view
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.guard import ADMIN, OBSERVE, OPERATE, Note
from pincette_supervisor.rest.headers import Who, sender
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.punctuality import punctuality
from pincette_supervisor.running.rigs import Rigs
from pincette_supervisor.running.view import rig_view


def routes(rigs: Rigs) -> APIRouter:
    """``/estop`` and everything under ``/rigs``; emergency stops have threads of their own."""
    router = APIRouter(tags=["rigs"])

    @router.post("/estop", responses=responses(503), dependencies=[OBSERVE])
    async def estop_all(request: Request) -> StoppedList:  # pyright: ignore[reportUnusedFunction]
        """Stop every rig at once; see the one of a rig. 503 where one has not confirmed."""
        by = sender(request)
        asked = [_estop(conductor, by) for conductor in rigs.all()]
        answers = await asyncio.gather(*asked, return_exceptions=True)
        stopped = [answer for answer in answers if isinstance(answer, Stopped)]
        silent = [str(answer) for answer in answers if not isinstance(answer, Stopped)]
        silent += [f"{rig}: {why}" for rig, why in rigs.unusable.items()]
        if silent:
            raise ProblemError(
                503,
                "estop-unconfirmed",
                "Not every rig has confirmed the emergency stop",
                "; ".join(silent),
                stopped=[answer.rig for answer in stopped],
                reasons=silent,
            )
        return StoppedList(rigs=stopped)

    @router.get("/rigs", dependencies=[OBSERVE])
    def every_rig() -> RigList:  # pyright: ignore[reportUnusedFunction]
        """The rigs this supervisor serves, its own first."""
        return RigList(rigs=rigs.of_all(rig_view))

    @router.get("/rigs/{rig}", responses=responses(404, 503), dependencies=[OBSERVE])
    def rig_state(rig: str) -> Rig:  # pyright: ignore[reportUnusedFunction]
        """One rig: programs, interlocks, limits, latch, and whether a job can start."""
        return rig_view(rigs.get(rig))

    @router.post("/rigs/{rig}/estop", responses=responses(404, 503), dependencies=[OBSERVE])
    async def estop(rig: str, request: Request) -> Stopped:  # pyright: ignore[reportUnusedFunction]
        """Stop at once: freeze a held part, ramp a free arm, latch. Always accepted; no body."""
        return await _estop(rigs.get(rig), sender(request))

    @router.post(
        "/rigs/{rig}/reset", responses=responses(404, 409, 422, 503), dependencies=[OPERATE]
    )
    def reset(  # pyright: ignore[reportUnusedFunction]
        rig: str, _body: ResetRequest, who: Who
    ) -> Stopped:
        """Clear the latch, once a person has seen the cause; a held part stays held."""
        return rigs.get(rig).latch.reset(who)

    @router.post(
        "/rigs/{rig}/queue/actions",
        responses=responses(404, 409, 422, 503),
        dependencies=[OPERATE],
    )
    def order_queue(  # pyright: ignore[reportUnusedFunction]
        rig: str, body: QueueRequest, who: Who, note: Note
    ) -> Rig:
        """Let a halted queue go on, or stop all jobs that wait."""
        note(body.type)
        conductor = rigs.get(rig)
        conductor.order_queue(body.type, who)
        return rig_view(conductor)

    @router.get("/rigs/{rig}/timing", responses=responses(404, 503), dependencies=[OBSERVE])
    def timing(rig: str) -> LoopTiming:  # pyright: ignore[reportUnusedFunction]
        """How punctual the programs of the loop have been since they were armed."""
        return punctuality(rigs.get(rig).site.bus)

    @router.get("/rigs/{rig}/model", responses=responses(404, 503), dependencies=[OBSERVE])
    def model(rig: str) -> ModelView:  # pyright: ignore[reportUnusedFunction]
        """The model in use: every quantity that can be calibrated, and the versions there are."""
        return model_view(rigs.get(rig).site.model)

    @router.post(
        "/rigs/{rig}/model/actions",
        responses=responses(404, 409, 422, 503),
        dependencies=[ADMIN],
    )
    def use_model(  # pyright: ignore[reportUnusedFunction]
        rig: str, body: ModelAction, note: Note
    ) -> ModelView:
        """Go back to a version of the model, or with 0 to the rig file alone."""
        note(f"{body.type} {body.version}")
        return rigs.get(rig).use_model(body.version)

    return router


async def _estop(conductor: Conductor, by: str) -> Stopped:
    latch, loop = conductor.latch, asyncio.get_running_loop()
    return await loop.run_in_executor(latch.threads, latch.estop, by)
