"""Plans jobs with the model in use, from where the arm stands."""

from pincette.api.request_models import AnyJobRequest
from pincette_supervisor import problems
from pincette_supervisor.journal.recipes import RecipeBook
from pincette_supervisor.planning.calibration_support import UnsupportedError
from pincette_supervisor.planning.path_requests import FaultyRequestError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.recipes import completed, pinned, plan_with_recipe
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running.part import present
from pincette_supervisor.running.site import Site

FROM_WHERE_IT_STANDS = ("move", "hold", "release")
"""Kinds of job whose plan begins at the voltage that is applied."""


def plan(site: Site, request: AnyJobRequest, *, moving: bool) -> Planned:
    """Plan a job; raises ProblemError where the rig is another or the numbers make no plan.

    Where a job still moves the arm, nobody knows where it will stand for the next one.
    """
    rig = site.rig
    if request.rig is not None and request.rig != rig.rig.name:
        raise problems.not_found("rig", request.rig, [rig.rig.name])
    try:
        stands = None if moving and request.kind not in FROM_WHERE_IT_STANDS else present(site)
        return plan_with_recipe(request, site.model.in_use, stands, RecipeBook(site.store).find)
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


def with_version(site: Site, request: AnyJobRequest) -> AnyJobRequest:
    """The request with the version of the recipe that it names, so that it stays the same."""
    return pinned(request, RecipeBook(site.store).find)


def with_recipe(site: Site, request: AnyJobRequest) -> AnyJobRequest:
    """The request completed by its recipe, whose stop and abort may be of the recipe too.

    Raises
    ------
    FaultyRequestError
        Where there is no such recipe.
    """
    return completed(request, RecipeBook(site.store).find)
