"""Plan, result and plot of a hold."""

from functools import partial

from pincette.control.planning.motion_plan import plan_hold
from pincette_supervisor.kinds.functions import JobFunctions
from pincette_supervisor.kinds.hold import HoldJobRequest
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.planning.motion_plans import releasing_job
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present
from pincette_supervisor.results.motion import evaluate, plot


def plan(request: HoldJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a hold from where the arm stands."""
    make = partial(plan_hold, request.hold_s)
    values = {"hold_s": request.hold_s}
    return releasing_job(request, model, present, request.release_s, make, values)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
