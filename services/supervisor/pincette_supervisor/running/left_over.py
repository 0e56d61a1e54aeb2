"""What a supervisor does at its start about what an earlier one has left."""

from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Status
from pincette.topics import ACT
from pincette_supervisor.running.site import Site

ARMED = "armed"
"""How the actuator's own words begin while a program plays."""
ASK_S = 1.0


def settle(site: Site, jobs: list[str]) -> None:
    """Tell which jobs were interrupted, and stop a program that still plays.

    It is asked once. A held part stays held until a person holds or releases it by a job; a free
    arm comes to rest. Nothing is taken up again.

    Parameters
    ----------
    jobs
        Those that the journal has just marked as interrupted, the newest last.
    """
    stopped = _stop(site)
    for job in jobs:
        row = site.store.get(job)
        cause = "" if row is None else row.cause
        if stopped and job == jobs[-1]:
            cause = f"{cause}; {stopped}"
            site.store.change(job, cause=cause)
        site.events.tell("state", job, state="interrupted", cause=cause, event="interrupt")
    if stopped:
        site.events.tell("rig", jobs[-1] if jobs else None, found="a program played", did=stopped)


def _stop(site: Site) -> str:
    actuator = site.health.statuses.get("actuator")
    if not isinstance(actuator, Status) or not actuator.detail.startswith(ARMED):
        return ""
    try:
        site.bus.ask(ACT, Act("stop"), ASK_S)
    except RefusalError as error:
        return f"the program was not stopped: {error}"
    except BusError as error:
        return f"the program that still plays could not be stopped: {error}"
    return "the program that still played was stopped after the restart; a held part stays held"
