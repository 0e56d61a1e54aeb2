"""A supervisor, and through it rigs and jobs."""

from collections.abc import Iterator
from copy import copy
from types import TracebackType
from typing import Any, Literal

import httpx

from pincette.api.access_models import AuditEntry, Session
from pincette.api.event_models import Event
from pincette.api.proposal_models import Proposal
from pincette.api.recipe_models import Recipe, RecipeHistory
from pincette.api.rig_models import Rig, StoppedList
from pincette.client import access_calls, job_calls, recipe_calls, rig_calls
from pincette.client.choice import only
from pincette.client.job_handle import JobHandle
from pincette.client.line import Line
from pincette.client.rig_handle import RigHandle

TIMEOUT_S, PATIENCE_S = 10.0, 10.0


class Supervisor:
    """Where to begin: ``Supervisor(url).rig()``.

    ``timeout_s`` is how long one answer may take, ``patience_s`` how long a call that may safely
    be made again is made again while nobody answers. ``operator`` is who asks, as it is kept with
    every action; left out, the supervisor keeps the address. ``key`` is for a supervisor that wants
    one; who asks is then the key's name, with ``operator`` beside it.
    """

    def __init__(
        self,
        url: str,
        *,
        timeout_s: float = TIMEOUT_S,
        patience_s: float = PATIENCE_S,
        operator: str | None = None,
        key: str | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.line = Line(url, timeout_s, patience_s, operator, key, transport)
        """What it speaks over; its clock and its sleep may be replaced."""

    def __enter__(self) -> "Supervisor":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the connections back."""
        self.line.close()

    def patient(self, patience_s: float) -> "Supervisor":
        """The same supervisor, with more patience or less while nobody answers."""
        other = copy(self)
        other.line = self.line.patient(patience_s)
        return other

    def rigs(self) -> list[Rig]:
        """Every rig that it serves."""
        found = self.line.send(rig_calls.rigs())
        return found.rigs

    def rig(self, name: str | None = None) -> RigHandle:
        """A rig by its name; without one the only rig there is."""
        return RigHandle(self.line, name or only(self.rigs()))

    def job(self, name: str) -> JobHandle:
        """A job by its id, of whichever rig."""
        return JobHandle(self.line, self.line.send(job_calls.job(name)))

    def jobs(self, limit: int = 50, **filters: str | int) -> list[JobHandle]:
        """Jobs of every rig, the newest first; filters are rig, state, kind, label and before."""
        found = self.line.send(job_calls.jobs({"limit": limit, **filters}))
        return [JobHandle(self.line, job) for job in found.jobs]

    def events(self, after: int | None = None) -> Iterator[Event]:
        """Events of every rig as they come, from those after a number; else from here on."""
        begin = rig_calls.newest_event(None) if after is None else after
        return self.line.events(rig_calls.events_of(None), begin)

    def estop(self) -> StoppedList:
        """Stop every rig at once; refused where one has not confirmed, which names it."""
        return self.line.send(rig_calls.estop_all())

    def proposals(self, limit: int = 50) -> list[Proposal]:
        """What calibrations propose, the newest first."""
        found = self.line.send(rig_calls.proposals(limit))
        return found.calibrations

    def proposal(self, calibration: str) -> Proposal:
        """What one calibration proposes, beside what is in use."""
        return self.line.send(rig_calls.proposal(calibration))

    def decide(self, calibration: str, decision: Literal["accept", "discard"]) -> Proposal:
        """Use what a calibration proposes, or do not."""
        return self.line.send(rig_calls.decide(calibration, decision))

    def recipes(self) -> list[Recipe]:
        """The newest version of every part recipe."""
        found = self.line.send(recipe_calls.recipes())
        return found.recipes

    def recipe(self, name: str) -> RecipeHistory:
        """One recipe with all its versions."""
        return self.line.send(recipe_calls.recipe(name))

    def save_recipe(self, name: str, values: dict[str, Any], note: str = "") -> Recipe:
        """Keep a set of parameters under a name, as its next version."""
        return self.line.send(recipe_calls.save(name, values, note))

    def session(self) -> Session:
        """Who asks, and what they may do, as the supervisor knows it."""
        return self.line.send(access_calls.session())

    def audit(self, limit: int = 50, before: int | None = None) -> list[AuditEntry]:
        """What was to change something, the newest first; those before a number."""
        found = self.line.send(access_calls.audit(limit, before))
        return found.entries
