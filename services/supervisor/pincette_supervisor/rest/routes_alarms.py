"""Alarms over REST: listed, and acknowledged by a person."""

from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field

from pincette.api.events import Alarm, AlarmAction, AlarmList
from pincette.api.problems import responses
from pincette.records.folder import agree_to_clock
from pincette_supervisor import problems
from pincette_supervisor.access.access import KEY_CLOCK
from pincette_supervisor.journal.alarm_rows import AlarmRepository, AlarmRow
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    OBSERVE,
    OPERATE,
    AccessState,
    AllRigs,
    Journal,
    Note,
    Operator,
    authorize,
)
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.watch.checks import CLOCK

LARGEST = 2**63 - 1
Number = Annotated[int, Field(ge=1, le=LARGEST)]
Text = Annotated[str | None, Query(max_length=80)]


router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=StrictRoute)


@router.get("", dependencies=[OBSERVE])
def alarms(
    store: Journal,
    rig: Text = None,
    job: Text = None,
    cause: Text = None,
    severity: Literal["alarm", "warning"] | None = None,
    only_open: Annotated[bool, Query(alias="open", description="only those that are open")] = False,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    before: Annotated[
        int | None, Query(ge=1, le=LARGEST, description="begin below this id")
    ] = None,
) -> AlarmList:
    """Alarms of every rig, the newest first."""
    repository = AlarmRepository(store)
    rows = repository.newest(
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
        open=repository.count_open(rig),
    )


@router.get("/{alarm}", responses=responses(404), dependencies=[OBSERVE])
def one(alarm: Number, store: Journal) -> Alarm:
    """One alarm."""
    return alarm_of(_found(AlarmRepository(store).get(alarm), alarm))


@router.post("/{alarm}/actions", responses=responses(404), dependencies=[OPERATE])
def act(
    request: Request,
    alarm: Number,
    body: AlarmAction,
    rigs: AllRigs,
    access: AccessState,
    by: Operator,
    note: Note,
) -> Alarm:
    """Acknowledge an alarm; done twice, it stays with who was first.

    To acknowledge the alarm `clock` is to agree to the present time of day: records may be deleted
    for their age again. To acknowledge `key-clock`, which needs the scope `admin`, is to agree that
    the ends of keys are judged by the present time of day.
    """
    note(body.type)
    row = _found(AlarmRepository(rigs.store).get(alarm), alarm)
    context = rigs.of_row(row.rig).context
    if row.cause == CLOCK and row.cleared_at is None:
        try:
            agree_to_clock(context.records)
        except OSError as error:
            raise ProblemError(
                503, "store-failed", "The records' folder cannot be written", str(error)
            ) from error
    if row.cause == KEY_CLOCK and row.cleared_at is None:
        authorize(request, ("admin",))
        access.authenticator.agree_to_time(rigs.store)
    return alarm_of(_found(context.alarms.acknowledge(alarm, by), alarm))


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
