"""What a stop and an abort do to a held part, as the request has it; the default never drops it."""

from pincette.api.request_models import AnyJobRequest
from pincette.messages import Act, Trip

STOPS = {"hold": "stop", "release": "let_go", "retract": "retract"}
"""The controller's action for each ``on_stop``."""


def on_stop(request: AnyJobRequest) -> str:
    """What a stop does: hold, release or retract."""
    return getattr(request, "on_stop", "hold")


def stop_act(request: AnyJobRequest) -> Act:
    """What the controller is asked for by a stop."""
    return Act(STOPS[on_stop(request)])


def abort_trip(request: AnyJobRequest, cause: str) -> Trip:
    """What the actuator is asked for by an abort; freeze unless the request says ramp."""
    return Trip(cause, let_go=getattr(request, "on_abort", "freeze") == "ramp")
