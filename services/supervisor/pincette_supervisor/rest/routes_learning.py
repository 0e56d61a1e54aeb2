"""What programs have learned across their cycles over REST: list it, erase it."""

from typing import Annotated

from fastapi import APIRouter, Path, Query

from pincette.api.learning import Erased, LearnedList, LearnedProgram
from pincette.api.problems import responses
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.library import LearnedRepository, LearnedRow
from pincette_supervisor.rest.dependencies import OBSERVE, OPERATE, Manager, Note
from pincette_supervisor.rest.strict_route import StrictRoute

PROGRAM = "^[0-9a-f]{16}$"
"""Form of a program's digest."""

router = APIRouter(prefix="/rigs/{rig}/learning", tags=["learning"], route_class=StrictRoute)


def _repository(manager: JobManager) -> LearnedRepository:
    return LearnedRepository(manager.context.store, manager.name)


@router.get("", responses=responses(404), dependencies=[OBSERVE])
def learned(
    manager: Manager,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    before: Annotated[
        str | None, Query(description="programs after this one", pattern=PROGRAM)
    ] = None,
) -> LearnedList:
    """What the programs of a rig have learned, with the error over their cycles."""
    rows = _repository(manager).all()
    if before is not None:
        programs = [row.program for row in rows]
        if before not in programs:
            raise problems.not_found("program that has learned", before)
        rows = rows[programs.index(before) + 1 :]
    return LearnedList(
        rig=manager.name,
        programs=[_view(row) for row in rows[:limit]],
        next=rows[limit - 1].program if len(rows) > limit else None,
    )


@router.delete("", responses=responses(404, 409), dependencies=[OPERATE])
def erase_all(manager: Manager, note: Note) -> Erased:
    """Forget what every program has learned; a job that runs keeps what it began with."""
    note("all")
    return Erased(rig=manager.name, erased=_repository(manager).erase())


@router.delete("/{program}", responses=responses(404, 409), dependencies=[OPERATE])
def erase(program: Annotated[str, Path(pattern=PROGRAM)], manager: Manager, note: Note) -> Erased:
    """Forget what one program has learned."""
    note(program)
    erased = _repository(manager).erase(program)
    if not erased:
        raise problems.not_found("program that has learned", program)
    return Erased(rig=manager.name, erased=erased)


def _view(row: LearnedRow) -> LearnedProgram:
    known = row.corrections
    return LearnedProgram(
        program=row.program,
        job=row.job,
        learned_at=row.learned_at,
        motion=row.motion,
        cycles=len(known.errors_um),
        over=known.over,
        values_um=list(known.values_um),
        errors_um=list(known.errors_um),
    )
