"""Takes jobs and actions, one job at a time, and says how they are."""

import secrets
import threading
from datetime import UTC, datetime
from typing import Literal, cast

from pincette.api.job_models import Job
from pincette.api.proposal_models import ModelView, Proposal
from pincette.api.request_models import AnyJobRequest
from pincette.api.rig_models import Stopped
from pincette.api.states import HOLDS, ActionType, TransitionError, allowed_actions
from pincette.bus.protocol import BusError, RefusalError
from pincette.messages import Act, Done, Trip
from pincette.topics import ACT, TRIP
from pincette_supervisor import problems
from pincette_supervisor.journal.store import JobRow, utc_now
from pincette_supervisor.model.model_view import use_model
from pincette_supervisor.model.proposals import Calibrations
from pincette_supervisor.planning.calibration_support import UnsupportedError
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.path_requests import FaultyRequestError
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running.job import Changes, LiveJob
from pincette_supervisor.running.job_view import job_view
from pincette_supervisor.running.run import Run
from pincette_supervisor.running.site import Site

JOIN_S = 4.0
FREED_S = 1.0
"""In which a rig is free once its job has told its end."""


class Conductor:
    """The jobs of one rig."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.calibrations = Calibrations(site.store, site.model)
        self.changes = Changes()
        self._lock = threading.Lock()
        self._live: LiveJob | None = None
        self._run: Run | None = None
        self._thread: threading.Thread | None = None

    @property
    def active(self) -> LiveJob | None:
        """The job that has the rig; a stopped one keeps it while it holds a part."""
        live = self._live
        return None if live is None or live.done.is_set() else live

    def plan(self, request: AnyJobRequest) -> Planned:
        """Plan a job; raises ProblemError where the rig is another or the numbers make no plan."""
        rig = self.site.rig
        if request.rig is not None and request.rig != rig.rig.name:
            raise problems.not_found("rig", request.rig, [rig.rig.name])
        try:
            return plan_job(request, self.site.model.in_use)
        except FaultyRequestError as error:
            fault = {"pointer": error.pointer, "message": str(error)}
            raise ProblemError(
                422,
                "invalid-request",
                "The request cannot be used",
                str(error),
                errors=[fault],
            ) from error
        except UnsupportedError as error:
            raise problems.unsupported(error) from error
        except ValueError as error:
            raise ProblemError(
                422, "invalid-request", "No plan can be made of this", str(error)
            ) from error

    def submit(self, request: AnyJobRequest) -> Job:
        """Take a job; raises ProblemError where it cannot be."""
        planned = self.plan(request)
        if not planned.plan.feasible:
            violations = [item.model_dump() for item in planned.plan.violations]
            raise ProblemError(
                422,
                "limit-violation",
                "The plan breaks a limit of the rig",
                "; ".join(item.message for item in planned.plan.violations),
                violations=violations,
            )
        with self._lock:
            self._require_free()
            self._require_ready()
            if planned.model is not self.site.model.in_use:
                raise ProblemError(
                    409,
                    "model-changed",
                    "Another model has come into use",
                    "the job was planned with the model before; send it again",
                )
            stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
            row = JobRow(
                id=f"{stamp}-{secrets.token_hex(2)}",
                kind=request.kind,
                rig=self.site.rig.rig.name,
                state="queued",
                request=request.model_dump(mode="json", exclude_unset=True),
                plan={**planned.plan.model_dump(mode="json"), "values": planned.values},
                created_at=utc_now(),
            )
            self.site.store.add(row)
            self._live = LiveJob(
                row, planned, self.site.store, self.changes, autostart=request.autostart
            )
            self._run = Run(self.site, self._live)
            self._thread = threading.Thread(target=self._run.main, name=f"job {row.id}")
            self._thread.start()
        return self.job(row.id)

    def _require_free(self) -> None:
        active = self.active
        if active is not None and active.terminal and not active.held:
            active.done.wait(FREED_S)
            active = self.active
        if active is None:
            return
        doing = f"is {active.state}"
        if active.terminal:
            doing += ", holds a part: release it" if active.held else ", the arm is not at rest yet"
        raise ProblemError(
            409,
            "job-active",
            "Another job has the rig",
            f"job {active.id} {doing}",
            job=active.id,
            allowed_actions=allowed_actions(active.state, held=active.held),
        )

    def _require_ready(self) -> None:
        health = self.site.health
        health.refresh()
        cause = health.latched()
        if cause:
            name = self.site.rig.rig.name
            code = "estop-engaged" if cause == "estop" else "rig-latched"
            raise ProblemError(
                409,
                code,
                "The actuator is latched",
                f"cause: {cause}; see that the rig is safe, then POST /api/v1/rigs/{name}/reset "
                'with {"acknowledge": true}',
                cause=cause,
            )
        reasons = self.site.reasons()
        if reasons:
            raise ProblemError(
                503, "rig-not-ready", "The rig is not ready", "; ".join(reasons), reasons=reasons
            )

    def act(self, name: str, action: ActionType, by: str) -> tuple[Job, bool]:
        """Ask a job for an action; the flag says that what was asked for holds already.

        Raises
        ------
        ProblemError
            Where the job does not exist, or its state does not allow the action.
        """
        live = self.active
        if live is None or live.id != name:
            row = self._row(name)
            if row.state in HOLDS[action]:
                return self.job(name), True
            raise self._invalid(action, row.state, [])
        state = live.state
        waiting = live.waiting
        allowed = allowed_actions(state, held=live.held, waiting=waiting is not None)
        if state in HOLDS[action] and action not in allowed:
            return self.job(name), True
        if action not in allowed:
            raise self._invalid(action, state, allowed)
        live.asked(action, by)
        try:
            if action in ("release", "continue"):
                self.site.bus.ask(ACT, Act(action))
                if action == "continue" and waiting is not None:
                    live.proceed(waiting)
            elif not live.terminal and not live.move(action, only_from=state):
                raise TransitionError(f"the job has just become {live.state}")
            if action == "abort" and state in ("running", "stopping", "stopped"):
                reply = self.site.bus.ask(TRIP, Trip("abort"), 1.0)
                live.acted("abort", cast(Done, reply).seq)
        except (RefusalError, TransitionError) as error:
            raise self._invalid(action, live.state, allowed, str(error)) from error
        except BusError as error:
            raise ProblemError(
                503, "rig-not-ready", "The rig does not answer", str(error), reasons=[str(error)]
            ) from error
        return self.job(name), False

    def _invalid(
        self, action: str, state: str, allowed: list[ActionType], why: str = ""
    ) -> ProblemError:
        detail = why or f"a job that is {state} cannot {action}"
        return ProblemError(
            409,
            "invalid-transition",
            "The job's state does not allow this action",
            detail,
            state=state,
            allowed_actions=allowed,
        )

    def decide(self, name: str, action: Literal["accept", "discard"]) -> Proposal:
        """Accept or discard what a calibration proposes; raises ProblemError."""
        with self._lock:
            self._require_free()
            return self.calibrations.act(name, action)

    def use_model(self, version: int) -> ModelView:
        """Go over to a version of the model; raises ProblemError."""
        with self._lock:
            self._require_free()
            return use_model(self.site.model, version)

    def estop(self) -> Stopped:
        """Trip the actuator at once; takes no lock and touches no disk."""
        rig = self.site.rig.rig.name
        try:
            self.site.bus.ask(TRIP, Trip("estop"), 1.0)
        except BusError as error:
            raise ProblemError(
                503,
                "estop-unconfirmed",
                "The actuator did not confirm the emergency stop",
                f"{error}; switch the amplifier off by hand",
            ) from error
        return Stopped(rig=rig, cause="estop", acknowledged=True, detail="")

    def reset(self) -> Stopped:
        """Clear the latch, since a person has seen the cause."""
        _, cause = self.site.health.latch()
        try:
            self.site.health.reset()
        except RefusalError as error:
            raise ProblemError(
                409, "reset-refused", "The actuator refuses to be reset", str(error)
            ) from error
        except BusError as error:
            raise ProblemError(
                503, "rig-not-ready", "The rig does not answer", str(error), reasons=[str(error)]
            ) from error
        return Stopped(rig=self.site.rig.rig.name, cause=cause, acknowledged=True, detail="")

    def _row(self, name: str) -> JobRow:
        row = self.site.store.get(name)
        if row is None:
            raise problems.not_found("job", name)
        return row

    def job(self, name: str) -> Job:
        """One job as it is; raises ProblemError where there is none of this name."""
        return self._view(self._row(name))

    def jobs(self, limit: int) -> list[Job]:
        """Jobs, the newest first."""
        return [self._view(row) for row in self.site.store.newest(limit)]

    def over(self, name: str) -> bool:
        """Whether a job has come to an end, without a look at the store where it lives."""
        live = self._live
        return live is None or live.id != name or live.terminal

    def _view(self, row: JobRow) -> Job:
        live = self._live if self._live is not None and self._live.id == row.id else None
        return job_view(row, live, self.site.records)

    def close(self) -> None:
        """End: a job that runs becomes ``interrupted`` and the rig is asked to stop."""
        run, live, thread = self._run, self._live, self._thread
        if run is None or live is None or thread is None:
            return
        run.interrupted = True
        live.wake.set()
        thread.join(JOIN_S)
