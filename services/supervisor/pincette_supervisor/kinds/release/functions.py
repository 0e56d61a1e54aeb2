"""Plan, result and plot of a release."""

from pincette.control.planning.motion_plan import plan_release
from pincette_supervisor.kinds.functions import JobFunctions
from pincette_supervisor.kinds.release import ReleaseJobRequest
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.planning.motion_plans import releasing_job
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present
from pincette_supervisor.results.motion import evaluate, plot


def plan(request: ReleaseJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a release from where the arm stands."""
    return releasing_job(request, model, present, request.release_s, plan_release, {})


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
