"""Predictions one at a time, and those of late kept: each takes a processor for itself."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable

from pincette.api.job_kinds import job_kinds
from pincette_supervisor.planning.dry_run import DryRun
from pincette_supervisor.planning.prediction import played, with_prediction
from pincette_supervisor.plugin import Planned
from pincette_supervisor.problems import ProblemError

Play = Callable[[Planned], DryRun]
KEPT = 8
WAITING = 4
"""Greatest number of callers that wait for their turn: their threads serve other requests too, and
there are six of them (``WORKERS`` of the server)."""


class PredictionCache:
    """Plays plans on the model they were made with; safe to use from several threads."""

    def __init__(self, play: Play = played) -> None:
        self._play = play
        self._turn = threading.Lock()
        self._room = threading.BoundedSemaphore(WAITING)
        self._kept: OrderedDict[str, DryRun] = OrderedDict()

    def dry_run(self, planned: Planned) -> DryRun:
        """Play a plan, or return what the same plan has come to.

        Raises
        ------
        ProblemError
            Where too many wait already.
        """
        if not self._room.acquire(blocking=False):
            raise ProblemError(
                503,
                "busy",
                "Too many predictions at once",
                f"{WAITING} predictions wait already, the most: ask again in a moment",
            )
        try:
            return self._in_turn(planned)
        finally:
            self._room.release()

    def predicted(self, planned: Planned) -> Planned:
        """Return a plan with what playing it predicts.

        A new force on a held part is planned alone: what its arm remembers of the grip is not known
        to a model.

        Raises
        ------
        ProblemError
            Where too many wait already, or nothing of it can be played.
        """
        if planned.program.takes_force_over:
            return planned
        try:
            return with_prediction(planned, self.dry_run(planned))
        except ValueError as error:
            raise ProblemError(
                422, "no-prediction", "The plan cannot be played on the model in use", str(error)
            ) from error

    def checked(self, planned: Planned) -> Planned:
        """A plan before a job is made of it: where playing it breaks a limit, with what that says.

        A part that is held must be let go whatever is predicted, and a calibration is there to find
        the model that would predict it: neither is played. However many look ahead, a job that
        is to begin waits for the one that is being played alone.
        """
        if not job_kinds()[planned.plan.kind].predicted:
            return planned
        try:
            predicted = with_prediction(planned, self._in_turn(planned))
        except ValueError:  # nothing of it can be played, and so nothing is predicted
            return planned
        return planned if predicted.plan.feasible else predicted

    def _in_turn(self, planned: Planned) -> DryRun:
        with self._turn:
            return self._played(planned)

    def _played(self, planned: Planned) -> DryRun:
        model = planned.armed
        stands = None if planned.present is None else planned.present.voltage_V
        whose = planned.program, planned.values, stands, model.rig_file_digest, model.digest
        key = hashlib.sha256(repr(whose).encode()).hexdigest()
        found = self._kept.pop(key, None)
        if found is None:
            found = self._play(planned)
        self._kept[key] = found
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return found
