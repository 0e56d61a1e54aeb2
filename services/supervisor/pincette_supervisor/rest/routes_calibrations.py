"""Calibrations and the model in use over REST."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from pincette.api.calibration_models import CalibrationPlan
from pincette.api.calibration_requests import CalibrationBody
from pincette.api.job_models import Job
from pincette.api.problem_models import responses
from pincette.api.proposal_models import Proposal, ProposalAction, ProposalList
from pincette_supervisor.rest.guard import ADMIN, OBSERVE, OPERATE, Note
from pincette_supervisor.rest.headers import Key, Who
from pincette_supervisor.rest.routes_jobs import CREATED, NAME_LENGTH, Predict, take
from pincette_supervisor.running.rigs import Rigs


def routes(rigs: Rigs) -> APIRouter:
    """Everything under ``/calibrations``."""
    router = APIRouter(prefix="/calibrations", tags=["calibrations"])

    @router.post(
        "",
        status_code=201,
        response_model=Job | CalibrationPlan,
        responses=CREATED,
        dependencies=[OPERATE],
    )
    def create(  # pyright: ignore[reportUnusedFunction]
        body: CalibrationBody,
        response: Response,
        who: Who,
        note: Note,
        dry_run: Annotated[bool, Query(description="plan only")] = False,
        predict: Predict = True,
        idempotency_key: Key = None,
    ) -> object:
        """Take a calibration: the same as a job of the kind ``calibrate``."""
        conductor = rigs.of_request(body, idempotency_key)
        return take(
            conductor,
            body,
            response,
            dry_run=dry_run,
            by=who,
            note=note,
            predict=predict,
            key=idempotency_key,
        )

    @router.get("", responses=responses(404, 422, 503), dependencies=[OBSERVE])
    def proposals(  # pyright: ignore[reportUnusedFunction]
        limit: Annotated[int, Query(ge=1, le=500)] = 50,
        rig: Annotated[str | None, Query(max_length=NAME_LENGTH)] = None,
    ) -> ProposalList:
        """What calibrations that succeeded propose, of every rig or of one, the newest first."""
        asked = rigs.all() if rig is None else [rigs.get(rig)]
        found = [proposal for one in asked for proposal in one.calibrations.newest(limit)]
        found.sort(key=lambda proposal: proposal.made_at, reverse=True)
        return ProposalList(calibrations=found[:limit])

    @router.get("/{calibration}", responses=responses(404), dependencies=[OBSERVE])
    def proposal(calibration: str) -> Proposal:  # pyright: ignore[reportUnusedFunction]
        """One proposal beside what is in use; its name is that of its job."""
        return rigs.of_job(calibration).calibrations.one(calibration)

    @router.post(
        "/{calibration}/actions",
        responses=responses(404, 409, 422, 503),
        dependencies=[ADMIN],
    )
    def act(  # pyright: ignore[reportUnusedFunction]
        calibration: str, body: ProposalAction, note: Note
    ) -> Proposal:
        """Accept a proposal, which makes a version of the model and uses it, or discard it."""
        note(body.type)
        return rigs.of_job(calibration).decide(calibration, body.type)

    return router
