"""Proposals of calibrations: what they say, and what becomes of them."""

import json
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, cast

from pincette.api.calibrations import CalibrationResult, Proposal, ProposalState, ProposedValue
from pincette.config import ConfigError
from pincette_supervisor import problems
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store, utc_now
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.model.quantities import ASSUMED, values_of
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.problems import ProblemError

BASE = "/api/v1"
LONGEST = 500
"""Proposals that are looked at to see which one supersedes."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What became of a proposal, and what was in use until then."""

    state: ProposalState
    at: str
    version: int | None = None
    in_use: dict[str, Any] = field(default_factory=dict[str, Any])
    sources: dict[str, str] = field(default_factory=dict[str, str])


class Calibrations:
    """The proposals of one rig."""

    def __init__(self, store: Store, model: RigModel) -> None:
        self._store, self._model = store, model
        self._rig = model.file.rig.name

    def newest(self, limit: int, before: int | None = None) -> list[tuple[int, Proposal]]:
        """Return proposals with the numbers of their jobs, the newest first."""
        return [(row.number or 0, self._view(row)) for row in self._rows(limit, before)]

    def one(self, name: str) -> Proposal:
        """One proposal; raises ProblemError where there is none of this name."""
        return self._view(self._row(name))

    def _rows(self, limit: int, before: int | None = None) -> list[JobRow]:
        wanted = JobFilter(kind=KIND.name, state="succeeded", rig=self._rig, before_number=before)
        return self._store.newest(limit, wanted)

    def _row(self, name: str) -> JobRow:
        row = self._store.get(name)
        if row is None or (row.kind, row.state, row.rig) != (KIND.name, "succeeded", self._rig):
            raise problems.not_found("proposal of a calibration", name)
        return row

    def _decision(self, name: str) -> Decision | None:
        noted = self._store.get_note(_note(name))
        return None if noted is None else Decision(**json.loads(noted))

    def _decide(self, name: str, decision: Decision) -> None:
        self._store.set_note(_note(name), json.dumps(asdict(decision)))

    def act(self, name: str, action: Literal["accept", "discard"]) -> Proposal:
        """Accept or discard a proposal.

        Raises
        ------
        ProblemError
            Where there is none, it is decided about, or its values make an impossible rig.
        """
        row = self._row(name)
        decided = self._decision(name)
        if decided is not None:
            raise ProblemError(
                409,
                "invalid-transition",
                "The proposal is decided about",
                f"calibration {name} is {decided.state} since {decided.at}",
                state=decided.state,
                allowed_actions=[],
            )
        before = self._model.in_use
        in_use, sources = values_of(before.rig), dict(before.calibration.sources)
        version: int | None = None
        if action == "accept":
            version = self._accept(row)
        proposed = [value.quantity for value in _result(row).values]
        decision = Decision(
            "accepted" if action == "accept" else "discarded",
            utc_now(),
            version,
            {quantity: in_use[quantity] for quantity in proposed},
            {quantity: sources.get(quantity, ASSUMED) for quantity in proposed},
        )
        self._decide(name, decision)
        if action == "accept":
            self._supersede(row)
        return self._view(row)

    def _accept(self, row: JobRow) -> int:
        found = _result(row).values
        try:
            used = self._model.add(
                {value.quantity: value.value for value in found},
                {value.quantity: value.uncertainty for value in found},
                row.id,
                row.ended_at or row.created_at,
            )
        except ConfigError as error:
            raise ProblemError(
                422, "impossible-model", "The values make an impossible rig", str(error)
            ) from error
        except OSError as error:
            raise ProblemError(
                503, "model-not-kept", "The model cannot be written", str(error)
            ) from error
        return used.version

    def _supersede(self, accepted: JobRow) -> None:
        """What was accepted before of the same kind, or waits since before, is superseded."""
        kind = _result(accepted).calibration
        for row in self._rows(LONGEST):
            if row.id == accepted.id or _result(row).calibration != kind:
                continue
            decision = self._decision(row.id)
            if decision is None and row.created_at <= accepted.created_at:
                self._decide(row.id, Decision("superseded", utc_now()))
            elif decision is not None and decision.state == "accepted":
                self._decide(row.id, replace(decision, state="superseded"))

    def _view(self, row: JobRow) -> Proposal:
        result, decision, model = _result(row), self._decision(row.id), self._model.in_use
        in_use: dict[str, Any] = values_of(model.rig)
        sources = dict(model.calibration.sources)
        if decision is not None:
            in_use, sources = {**in_use, **decision.in_use}, {**sources, **decision.sources}
        return Proposal(
            id=row.id,
            calibration=result.calibration,
            rig=row.rig,
            state="proposed" if decision is None else decision.state,
            made_at=row.ended_at or row.created_at,
            decided_at=None if decision is None else decision.at,
            model_version=None if decision is None else decision.version,
            values=[_beside(value.model_dump(), in_use, sources) for value in result.values],
            figures=result.figures,
            residuals=result.residuals,
            statement=result.statement,
            warnings=result.warnings,
            assumptions=result.assumptions,
            made_with=cast("dict[str, Any]", row.plan.get("values", {}).get("model", {})),
            job=f"{BASE}/jobs/{row.id}",
            plot=f"{BASE}/jobs/{row.id}/artifacts/{KIND.plot}",
            allowed_actions=["accept", "discard"] if decision is None else [],
        )


def _note(name: str) -> str:
    return f"calibration {name}"


def _result(row: JobRow) -> CalibrationResult:
    return CalibrationResult.model_validate(row.result)


def _beside(
    value: dict[str, Any], in_use: dict[str, Any], sources: dict[str, str]
) -> ProposedValue:
    """A proposed value with the one in use, and the difference where both are numbers."""
    quantity, found = value["quantity"], value["value"]
    present = in_use[quantity]
    numbers = isinstance(found, int | float) and isinstance(present, int | float)
    difference = found - present if numbers else None
    return ProposedValue(
        **value,
        in_use=present,
        source_in_use=sources.get(quantity, ASSUMED),
        difference=difference,
        difference_percent=None if difference is None else _percent(difference, present),
    )


def _percent(difference: float, of: float) -> float | None:
    return 100.0 * difference / of if of else None
