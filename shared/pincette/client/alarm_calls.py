"""Calls about alarms and readiness."""

from pincette.api.alarm_models import Alarm, AlarmList
from pincette.client.call import Call, model


def alarms(query: dict[str, str | float]) -> Call[AlarmList]:
    """Alarms, the newest first; the query narrows them down."""
    return Call("GET", "/alarms", model(AlarmList), query, repeatable=True)


def acknowledge(alarm: int) -> Call[Alarm]:
    """Say that a person has seen an alarm; said twice, it stays with who was first."""
    body = {"type": "acknowledge"}
    return Call("POST", f"/alarms/{alarm}/actions", model(Alarm), body=body, repeatable=True)
