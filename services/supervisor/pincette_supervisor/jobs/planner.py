"""Plans jobs with the model in use, from where the arm stands."""

from dataclasses import replace

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.control.record import replace as changed
from pincette_supervisor import problems
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.learned import LearnedRepository
from pincette_supervisor.journal.recipes import RecipeRepository
from pincette_supervisor.kinds.functions import kind_of
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.pair_grip import PairGripJobRequest
from pincette_supervisor.model.residuals import learning_digest
from pincette_supervisor.planning.errors import FaultyRequestError, UnsupportedError
from pincette_supervisor.planning.last_pose import last_pose_um
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present
from pincette_supervisor.planning.recipes import completed, pinned, plan_with_recipe
from pincette_supervisor.planning.recorded_jobs import recorded_motion
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.part import present
from pincette_supervisor.rigs.rig_context import RigContext

LOOKED_AT = 20
"""Number of jobs among which the last one that was armed is looked for."""


def plan(context: RigContext, request: JobRequest, *, moving: bool) -> Planned:
    """Plan a job, from an unknown position if a job moves the arm; raises ProblemError."""
    rig = context.rig
    if request.rig is not None and request.rig != rig.rig.name:
        raise problems.not_found("rig", request.rig, [rig.rig.name])
    try:
        request = for_arms(request, rig)
        stands = None if moving and not kind_of(request).from_present else present(context)
        if stands is not None and getattr(request, "by_um", None) is not None:
            rows = context.store.newest(LOOKED_AT, JobFilter(rig=rig.rig.name))
            stands = replace(stands, pose_um=last_pose_um(rows, stands))
        if request.plays is not None:
            recorded = recorded_motion(context.store, context.records, rig, request.plays)
            stands = replace(stands or Present(), recorded=recorded)
        planned = plan_with_recipe(
            request, context.model.in_use, stands, RecipeRepository(context.store).find
        )
        return with_learned(context, planned)
    except FaultyRequestError as error:
        raise _refused(error) from error
    except UnsupportedError as error:
        raise problems.unsupported(error) from error
    except ValueError as error:
        raise ProblemError(
            422, "invalid-request", "No plan can be made of this", str(error)
        ) from error


def with_learned(context: RigContext, planned: Planned) -> Planned:
    """The plan of a program that learns, with what it has learned in earlier jobs."""
    if planned.program.corrections is None:
        return planned
    name = learning_digest(planned.program, planned.armed.rig)
    known = LearnedRepository(context.store, context.rig.rig.name).find(name)
    if known is None:
        return planned
    program = changed(planned.program, corrections=known.corrections)
    return replace(planned, program=program)


def as_kept(context: RigContext, request: JobRequest) -> JobRequest:
    """The request for the arms that the rig has, with the version of the recipe that it names.

    So it stays the same. Raises ProblemError where it does not go with two arms.
    """
    try:
        request = for_arms(request, context.rig)
    except FaultyRequestError as error:
        raise _refused(error) from error
    return pinned(request, RecipeRepository(context.store).find)


def _refused(error: FaultyRequestError) -> ProblemError:
    fault = {"pointer": error.pointer, "message": str(error)}
    return ProblemError(
        422, "invalid-request", "The request cannot be used", str(error), errors=[fault]
    )


def with_recipe(context: RigContext, request: JobRequest) -> JobRequest:
    """The request completed by its recipe; raises FaultyRequestError without that recipe."""
    return completed(request, RecipeRepository(context.store).find)


def for_arms(request: JobRequest, rig: RigFile) -> JobRequest:
    """A grip as a grip with both arms where the rig has two; every other request as it is.

    Whoever asks for a force and a hold means whatever arms there are.

    Raises
    ------
    FaultyRequestError
        Where the grip says what is of one arm alone.
    """
    if rig.second is None or not isinstance(request, GripJobRequest):
        return request
    given = request.model_dump(exclude_unset=True)
    alone = sorted(given.keys() - PairGripJobRequest.model_fields.keys())
    if alone:
        raise FaultyRequestError(
            f"/{alone[0]}",
            f"{alone[0]} is of a grip with one driven arm, and this rig has two: leave it out, or "
            "ask for pair_grip",
        )
    gains = given.get("gains")
    if isinstance(gains, str):
        raise FaultyRequestError(
            "/gains", f"gains = {gains!r}: of two arms they are given by their names"
        )
    return PairGripJobRequest.model_validate({**given, "kind": "pair_grip"})
