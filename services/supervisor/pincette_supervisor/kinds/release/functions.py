"""Plan, result and plot of a release."""

from pincette.control.planning.motion_plan import plan_release
from pincette_supervisor.kinds.motions import evaluate, plot
from pincette_supervisor.kinds.release import ReleaseJobRequest
from pincette_supervisor.plugin import JobFunctions, ModelInUse, Planned, Present
from pincette_supervisor.plugin.plans import releasing_job


def plan(request: ReleaseJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a release from where the arm stands."""
    return releasing_job(request, model, present, request.release_s, plan_release, {})


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
