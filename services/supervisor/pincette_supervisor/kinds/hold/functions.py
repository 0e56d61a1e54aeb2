"""Plan, result and plot of a hold."""

from functools import partial

from pincette.control.planning.motion_plan import plan_hold
from pincette_supervisor.kinds.hold import HoldJobRequest
from pincette_supervisor.kinds.motions import evaluate, plot
from pincette_supervisor.plugin import JobFunctions, ModelInUse, Planned, Present
from pincette_supervisor.plugin.plans import releasing_job


def plan(request: HoldJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a hold from where the arm stands."""
    make = partial(plan_hold, request.hold_s)
    values = {"hold_s": request.hold_s}
    return releasing_job(request, model, present, request.release_s, make, values)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
