"""Resolves and plans requests with what a rig knows: model, recipes, records, and position."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from pincette.api.requests import JobRequest
from pincette_supervisor import problems
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.library import LearnedRepository, RecipeRepository
from pincette_supervisor.planning import job_plans
from pincette_supervisor.planning.job_plans import ResolvedRequest
from pincette_supervisor.planning.last_pose import last_pose_um
from pincette_supervisor.planning.recorded_jobs import recorded_motion
from pincette_supervisor.plugin import FaultyRequestError, Planned, Present, UnsupportedError
from pincette_supervisor.plugin.functions import kind_of
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import present

LOOKED_AT = 20
"""Number of jobs among which the last one that was armed is looked for."""


def resolve(context: RigContext, request: JobRequest, *, moving: bool) -> ResolvedRequest:
    """Look up what a request leaves out; raises ProblemError.

    Parameters
    ----------
    moving
        Whether a job moves the arm, so that its position is not known in advance.
    """
    rig = context.rig
    if request.rig is not None and request.rig != rig.rig.name:
        raise problems.not_found("rig", request.rig, [rig.rig.name])
    with _refusals():
        stands = None if moving and not kind_of(request).from_present else present(context)
        if stands is not None and getattr(request, "by_um", None) is not None:
            rows = context.store.newest(LOOKED_AT, JobFilter(rig=rig.rig.name))
            stands = replace(stands, pose_um=last_pose_um(rows, stands))
        if request.plays is not None:
            recorded = recorded_motion(context.store, context.records, rig, request.plays)
            stands = replace(stands or Present(), recorded=recorded)
        find = RecipeRepository(context.store).find
        return job_plans.resolve(request, context.model.in_use, stands, find)


def plan(context: RigContext, resolved: ResolvedRequest) -> Planned:
    """Plan a resolved request with what its program has learned; raises ProblemError."""
    learned = LearnedRepository(context.store, context.rig.rig.name)
    with _refusals():
        return job_plans.plan(
            resolved, lambda name: (row := learned.find(name)) and row.corrections
        )


@contextmanager
def _refusals() -> Generator[None]:
    """Raise ProblemError for a request that cannot be planned."""
    try:
        yield
    except FaultyRequestError as error:
        fault = {"pointer": error.pointer, "message": str(error)}
        raise ProblemError(
            422, "invalid-request", "The request cannot be used", str(error), errors=[fault]
        ) from error
    except UnsupportedError as error:
        raise problems.unsupported(error) from error
    except ValueError as error:
        raise ProblemError(
            422, "invalid-request", "No plan can be made of this", str(error)
        ) from error
