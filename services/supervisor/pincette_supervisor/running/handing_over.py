"""A moment for a job that has ended to free its rig, or to hand over the part that it holds."""

from pincette.bus.protocol import BusError
from pincette.messages import Act
from pincette.topics import ACT
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.running import refusals
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.site import Site

FREED_S = 1.0
"""In which a rig is free once its job has told its end."""
KEPT_S = 15.0
"""In which a job that only holds a part has handed it over, and its record is closed."""


def await_end(active: LiveJob | None) -> None:
    """Give a job that has ended, and holds nothing, a moment to free the rig."""
    if active is not None and active.terminal and not active.held:
        active.done.wait(FREED_S)


def hand_over(site: Site, active: LiveJob | None, planned: Planned) -> None:
    """Have a job that only holds a part end, where the next one begins with it.

    Raises
    ------
    ProblemError
        Where the controller does not answer.
    """
    if active is not None and active.terminal and active.held and planned.begins_held:
        try:
            site.bus.ask(ACT, Act("keep"))
        except BusError as error:
            raise refusals.unanswered(error) from error
        active.done.wait(KEPT_S)
