"""What the machine kept where a job tripped by the age of its commands, and what would suit it."""

from pincette.config import RigFile
from pincette.core.faults import Cause, Fault, FaultCode, fault
from pincette.engine.measuring.kept import asked, how, kept
from pincette.latency.advice import age_change
from pincette.latency.rule import TAIL
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.rigs.rig_context import RigContext


def silence_s(rig: RigFile, reason: TripReason) -> float | None:
    """For how long no command came before a trip by a stall, in s; None of another trip.

    What is told beside the silence is its cause, such as a reading that failed; and lockstep has no
    clock.
    """
    codes = [one.code for one in reason.faults]
    if rig.lockstep or reason.cause != Cause.COMMAND_AGE or codes != [FaultCode.NO_COMMAND]:
        return None
    return next((item.value for item in reason.faults[0].values if item.name == "silent_s"), None)


INSTRUMENTS = {"sensor": "sensor", "actuator": "output"}
"""Instrument of each program that has one."""


def exchange_fault(context: RigContext, reason: TripReason) -> Fault | None:
    """Return what the newest exchanges with the instruments took, for a trip by age; else None.

    Asks the programs, so that readings shortly before the trip are among them.
    """
    if context.rig.lockstep or reason.cause != Cause.COMMAND_AGE:
        return None
    context.health.refresh(force=True)
    values: dict[str, float] = {}
    for program, times in context.health.exchanges().items():
        for arm, took in enumerate(times):
            name = f"{'second_' if arm else ''}{INSTRUMENTS[program]}"
            values |= {
                f"{name}_minimum_s": took.minimum_s,
                f"{name}_median_s": took.median_s,
                f"{name}_worst_s": took.worst_s,
            }
    return fault(FaultCode.EXCHANGE_TIMES, **values) if values else None


def stall_words(context: RigContext, reason: TripReason) -> str:
    """What this machine kept and what to change, for people; empty of another trip."""
    rig = context.rig
    silent_s = silence_s(rig, reason)
    if silent_s is None:
        return ""
    ages = context.observer.counters.ages()
    transit_s = ages.quantile_s(TAIL) or rig.realtime.computing_s
    told = [
        f"unless a program hung, the machine stood still: commands came within "
        f"{1e3 * ages.max_s:.0f} ms of their samples, p99.9 {1e3 * transit_s:.0f} ms"
    ]
    known = kept(context.records.parent)
    late_s = max(0.0, silent_s - rig.rig.period_s)
    if known is not None:
        late_s = max(late_s, *(one.lateness.max_s for one in known.wake_ups))
    change = age_change(asked(rig), late_s, transit_s)
    told += [] if change is None else [f"what would suit it: {change.words()}"]
    return "; ".join([*told, how(rig)])
