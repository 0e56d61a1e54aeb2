"""Asks the controller for what a job's state wants of it, once in each state."""

from pincette.api.endings import Ending
from pincette.api.states import JobState
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.core.faults import ActionCode
from pincette.core.messages import Ack, Action
from pincette.core.topics import ACTION
from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.tracker import Tracker


class ControllerActions:
    """Stop, pause and resume of one job; ``moves`` is the count of the job's moves by now."""

    def __init__(self, bus: Bus, job: LiveJob, tracker: Tracker) -> None:
        self._bus, self._job, self._tracker = bus, job, tracker
        self._asked_in = -1
        """Count of the job's moves when the controller was last asked."""
        self._effective_seq: int | None = None
        """The seq at which the action takes effect; None where it was refused."""
        self._pause_asked = False

    def acts_since(self, seq: int) -> None:
        """Note that the controller stops by itself: asked again, it would begin anew."""
        self._asked_in, self._effective_seq = self._job.moves, seq

    def stopped_in_hold(self, moves: int) -> bool:
        """Ask for the stop; whether it is complete, since it keeps the part that is held."""
        tracker, request = self._tracker, self._job.request
        self._ask_once(ActionCode(policies.lease_end(request)), "stopping", moves)
        return tracker.stop_took_effect and tracker.held and policies.on_stop(request) == "hold"

    def pause(self, moves: int) -> None:
        """Ask for the pause, until the references rest."""
        self._pause_asked = True
        self._ask_once(ActionCode.PAUSE, "pausing", moves)
        if self._took_effect() and self._tracker.paused:
            self._job.move("rest", only_from="pausing")

    def resume(self, moves: int) -> None:
        """Go on where the pause began, or give up a pause that has not begun."""
        taken = not self._pause_asked or self._ask_once(ActionCode.RESUME, "resuming", moves)
        if taken and self._pause_asked and not (self._took_effect() and not self._tracker.paused):
            return
        self._pause_asked = False
        self._job.move("go_on", only_from="resuming")

    def _ask_once(self, action: ActionCode, state: JobState, moves: int) -> bool:
        """Ask once in a state; false where the controller refuses or does not answer."""
        if self._asked_in == moves:
            return self._effective_seq is not None
        self._asked_in, self._effective_seq = moves, None
        try:
            reply = self._bus.call(ACTION, Action(action))
        except RefusalError:
            return False  # the program has just ended; its last sample is on its way
        except BusError as error:
            ending = Ending(code="unanswered")
            self._job.move("overdue", str(error), only_from=state, ending=ending)
            return False
        self._effective_seq = reply.seq if isinstance(reply, Ack) else self._tracker.telemetry_seq
        return True

    def _took_effect(self) -> bool:
        """Whether the action has taken effect by the controller's newest sample."""
        return (
            self._effective_seq is not None and self._tracker.telemetry_seq >= self._effective_seq
        )
