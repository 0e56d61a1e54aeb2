"""Alarms over REST: listed, and acknowledged by a person."""

from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from pincette.api.alarm_models import Alarm, AlarmAction, AlarmList
from pincette.api.problem_models import responses
from pincette_supervisor import problems
from pincette_supervisor.journal.alarm_rows import AlarmBook, AlarmRow
from pincette_supervisor.rest.guard import OBSERVE, OPERATE, Note
from pincette_supervisor.rest.headers import Who
from pincette_supervisor.running.rigs import Rigs

LARGEST = 2**63 - 1
Number = Annotated[int, Field(ge=1, le=LARGEST)]
Text = Annotated[str | None, Query(max_length=80)]


def routes(rigs: Rigs) -> APIRouter:
    """Everything under ``/alarms``."""
    router = APIRouter(prefix="/alarms", tags=["alarms"])

    @router.get("", responses=responses(422, 503), dependencies=[OBSERVE])
    def alarms(  # pyright: ignore[reportUnusedFunction]
        rig: Text = None,
        job: Text = None,
        cause: Text = None,
        severity: Literal["alarm", "warning"] | None = None,
        only_open: Annotated[
            bool, Query(alias="open", description="only those that are open")
        ] = False,
        limit: Annotated[int, Query(ge=1, le=500)] = 50,
        before: Annotated[
            int | None, Query(ge=1, le=LARGEST, description="begin below this id")
        ] = None,
    ) -> AlarmList:
        """Alarms of every rig, the newest first."""
        book = AlarmBook(rigs.store)
        rows = book.newest(
            limit,
            rig=rig,
            job=job,
            cause=cause,
            severity=severity,
            only_open=only_open,
            before=before,
        )
        return AlarmList(
            alarms=[alarm_of(row) for row in rows],
            next=rows[-1].number if len(rows) == limit else None,
            open=book.count_open(rig),
        )

    @router.get("/{alarm}", responses=responses(404, 422, 503), dependencies=[OBSERVE])
    def one(alarm: Number) -> Alarm:  # pyright: ignore[reportUnusedFunction]
        """One alarm."""
        return alarm_of(_found(AlarmBook(rigs.store).get(alarm), alarm))

    @router.post("/{alarm}/actions", responses=responses(404, 422, 503), dependencies=[OPERATE])
    def act(  # pyright: ignore[reportUnusedFunction]
        alarm: Number, body: AlarmAction, who: Who, note: Note
    ) -> Alarm:
        """Acknowledge an alarm; done twice, it stays with who was first."""
        note(body.type)
        row = _found(AlarmBook(rigs.store).get(alarm), alarm)
        log = rigs.of_row(row.rig).site.alarms
        return alarm_of(_found(log.acknowledge(alarm, who), alarm))

    return router


def alarm_of(row: AlarmRow) -> Alarm:
    """An alarm as REST tells it."""
    tree = asdict(row)
    number = tree.pop("number")
    is_open = row.acknowledged_at is None or row.cleared_at is None
    return Alarm(id=number, open=is_open, **tree)


def _found(row: AlarmRow | None, number: int) -> AlarmRow:
    if row is None:
        raise problems.not_found("alarm", str(number))
    return row
