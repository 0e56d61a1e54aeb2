"""Planning of requests: resolved with the state of a rig, and stored as trajectories.

Relative steps begin at the position after the last move, so that they do not accumulate noise.
"""

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from pincette.api.job_kinds import job_kinds
from pincette.api.places import PlannedPlace
from pincette.api.requests import JobRequest, PlacedRequest, PolicyRequest
from pincette.api.trajectories import TrajectoryStart
from pincette.config import ConfigError, calibrated
from pincette_supervisor import problems
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.library import (
    LearnedRepository,
    RecipeRepository,
    TrajectoryRepository,
    TrajectoryRow,
)
from pincette_supervisor.journal.tables import JobRow
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning import job_plans
from pincette_supervisor.planning.job_plans import ResolvedRequest
from pincette_supervisor.planning.recorded_jobs import recorded_motion
from pincette_supervisor.plugin import (
    FaultyRequestError,
    ModelInUse,
    Planned,
    Present,
    UnsupportedError,
    kind_of,
)
from pincette_supervisor.plugin.model_in_use import rig_file_alone
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import present

LOOKED_AT = 20
"""Number of jobs that are searched for the most recently armed one."""


def resolve(
    context: RigContext, request: JobRequest, *, moving: bool, place: PlannedPlace | None = None
) -> ResolvedRequest:
    """Resolve the missing members of a request; raises ProblemError.

    Parameters
    ----------
    moving
        True if a job moves the arm, so that its position is not known in advance.
    place
        Position for which a recorded job was planned; None for the one in the request.
    """
    rig = context.rig
    if request.rig is not None and request.rig != rig.rig.name:
        raise problems.not_found("rig", request.rig, [rig.rig.name])
    with _refusals():
        stands = None if moving and not kind_of(request).from_present else present(context)
        if stands is not None and getattr(request, "by_um", None) is not None:
            rows = context.store.newest(LOOKED_AT, JobFilter(rig=rig.rig.name))
            stands = replace(stands, pose_um=last_pose_um(rows, stands))
        if request.plays is not None:
            recorded = recorded_motion(context.store, context.records, rig, request.plays)
            stands = replace(stands or Present(), recorded=recorded)
        find = RecipeRepository(context.store).find
        found = job_plans.resolve(request, context.model.in_use, stands, find)
        asked = found.request.place if isinstance(found.request, PlacedRequest) else None
        if place is None and asked is not None:
            place = context.places.given(asked)
        return found if place is None else job_plans.expecting_at(found, place)


def repeated(row: JobRow, **changes: Any) -> JobRequest:
    """Return the request of a job with other members, as the next job of the rig."""
    members = {**row.request, "kind": row.kind, "autostart": True, "queue": False, **changes}
    return REQUEST.validate_json(json.dumps(members))


def plan(context: RigContext, resolved: ResolvedRequest) -> Planned:
    """Plan a resolved request with its learned corrections; raises ProblemError."""
    learned = LearnedRepository(context.store, context.rig.rig.name)
    with _refusals():
        return job_plans.plan(
            resolved, lambda name: (row := learned.find(name)) and row.corrections
        )


@contextmanager
def _refusals() -> Generator[None]:
    """Raise ProblemError for a request that cannot be planned."""
    try:
        yield
    except FaultyRequestError as error:
        raise problems.unusable(str(error), pointer=error.pointer) from error
    except UnsupportedError as error:
        raise problems.unsupported(error) from error
    except ValueError as error:
        raise ProblemError(
            422, "invalid-request", "The request cannot be planned", str(error)
        ) from error


# Trajectories of a rig: created, looked up, and planned again from the original request.

OF_A_START = set(PolicyRequest.model_fields) - {"kind", "recipe"}
"""Members about the start and end of a job, which are not part of a trajectory."""


class TrajectoryStore:
    """The trajectories of one rig."""

    def __init__(self, context: RigContext) -> None:
        self._context = context
        self.book = TrajectoryRepository(context.store)
        self._find_recipe = RecipeRepository(context.store).find

    def row_of(self, resolved: ResolvedRequest) -> TrajectoryRow:
        """Return a request with the rig file and the model with which it was resolved.

        Raises
        ------
        ProblemError
            If its target depends on the position of the arm.
        """
        kept, model = resolved.kept, resolved.model
        for name in resolved.kind.relative:
            if getattr(kept, name) is not None:
                raise problems.unusable(
                    f"{name} depends on the present position, but a trajectory may be used at "
                    "any time: omit it, or give a target such as to_um",
                    pointer=f"/{name}",
                )
        tree = kept.model_dump(mode="json", exclude_unset=True, exclude=OF_A_START)
        return TrajectoryRow(
            rig=self._context.rig.rig.name,
            request=tree,
            rig_file_digest=model.rig_file_digest,
            model_version=model.version,
            model_digest=model.digest,
        )

    def get(self, digest: str) -> TrajectoryRow:
        """Return a stored trajectory; raises ProblemError if there is none of this digest."""
        row = self.book.get(digest)
        if row is None:
            raise problems.not_found("trajectory", digest)
        return row

    def stale(self, row: TrajectoryRow) -> list[str]:
        """Return what has changed since the trajectory was planned, in words."""
        model = self._context.model.in_use
        found: list[str] = []
        if (kind := row.request["kind"]) not in job_kinds():
            found.append(f"kind: {kind} is no longer known, create the trajectory again")
        if row.rig_file_digest != model.rig_file_digest:
            found.append(
                f"rig file {row.rig_file_digest} has been replaced by {model.rig_file_digest}"
            )
        if row.model_digest != model.digest:
            before, at_present = (
                f"version {version} ({digest})" if digest else "the rig file alone"
                for version, digest in (
                    (row.model_version, row.model_digest),
                    (model.version, model.digest),
                )
            )
            found.append(f"model: {before} was in use, now it is {at_present}")
        return found

    def planned(self, row: TrajectoryRow) -> Planned | None:
        """Return the original plan; None if its rig file, model or kind no longer exists."""
        model = self._model_of(row)
        if model is None or row.request["kind"] not in job_kinds():
            return None
        request = REQUEST.validate_python(row.request)
        resolved = job_plans.resolve(request, model, None, self._find_recipe)
        return job_plans.plan(resolved)

    def require_planned(self, row: TrajectoryRow) -> Planned:
        """Return the original plan; raises ProblemError if it cannot be computed."""
        planned = self.planned(row)
        if planned is None:
            raise self._stale(row)
        return planned

    def request(self, row: TrajectoryRow, start: TrajectoryStart) -> JobRequest:
        """Return the request of a job that follows the trajectory.

        Raises
        ------
        ProblemError
            If something has changed since the trajectory was planned, or the start does not fit the
            kind.
        """
        if self.stale(row):
            raise self._stale(row)
        options: dict[str, Any] = start.model_dump(mode="json", exclude_unset=True)
        for name in ("on_stop", "on_abort"):
            if options.get(name) is None:
                options.pop(name, None)
            elif not job_kinds()[row.request["kind"]].holds_part:
                raise problems.unusable(
                    f"{name}: a {row.request['kind']} holds no part", pointer=f"/{name}"
                )
        return REQUEST.validate_python({**row.request, **options})

    def _stale(self, row: TrajectoryRow) -> ProblemError:
        changed = self.stale(row)
        return ProblemError(
            409,
            "trajectory-stale",
            "The rig file or model that the trajectory was made with is not in use",
            f"{'; '.join(changed)}: send its request to /api/v1/trajectories again",
            changed=changed,
        )

    def _model_of(self, row: TrajectoryRow) -> ModelInUse | None:
        context, in_use = self._context, self._context.model.in_use
        if row.rig_file_digest != in_use.rig_file_digest:
            return None
        if row.model_digest == in_use.digest:
            return in_use
        if not row.model_digest:
            return rig_file_alone(context.model.file)
        try:
            stored = context.model.files.read(row.model_version)
            if stored.digest != row.model_digest:
                return None
            rig = calibrated(context.model.file, stored.calibration)
        except ConfigError:
            return None
        alone = rig_file_alone(context.model.file)
        return replace(
            alone,
            rig=rig,
            version=stored.version,
            calibration=stored.calibration,
            uncertainties=stored.uncertainties,
        )


SAME_V = 0.05
"""Largest difference in V at which the voltage counts as unchanged since the last move."""
NEAR_UM = 1.0
"""Distance from the last target within which the arm counts as being at the target, in µm."""


def last_pose_um(rows: Sequence[JobRow], present: Present) -> float | None:
    """Return the target of the last move, or the mean position of its rest if it has none.

    None if the most recently armed job is not a successful move, or if voltage or position differ
    from those at its end; then only the newest reading is known.
    """
    armed = [row for row in rows if row.epoch is not None]
    last = max(armed, key=lambda row: row.epoch or 0, default=None)
    if last is None or last.kind != "move" or last.state != "succeeded" or not last.result:
        return None
    ends_at: Mapping[str, float | None] = last.result.get("ends_at") or {}
    target_um: float | None = last.result.get("target_um")
    voltage_V, pose_um = ends_at.get("voltage_V"), target_um
    if pose_um is None:
        pose_um = ends_at.get("x_um")
    if pose_um is None or voltage_V is None:
        return None
    if present.voltage_V is None or present.x_um is None:
        return None
    if abs(voltage_V - present.voltage_V) > SAME_V or abs(pose_um - present.x_um) > NEAR_UM:
        return None
    return pose_um
