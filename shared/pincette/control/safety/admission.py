"""Which commands may act: authority, numbers, order, sample, age; and what a good one does.

A command is heard only from the owner and in the epoch that the arming named. What it knows of its
sample is held against the hard limits whether it is valid or not; then it is taken or refused.
"""

from dataclasses import dataclass
from math import isfinite
from typing import TypeVar

from pincette.control.replacing import replace
from pincette.control.safety.freshness import (
    ARRIVALS_KEPT,
    Arrival,
    arrival_of,
    newest_seq,
    too_old,
    with_sample,
)
from pincette.control.safety.latch import released, trip
from pincette.control.safety.monitors import finding, watch_command, watch_position
from pincette.control.safety.state import SafetyLimits, SafetyState, Strangers
from pincette.control.safety.voltage import VoltageLimits, absurd, limited, too_wide

S = TypeVar("S", bound=SafetyState)


@dataclass(frozen=True, slots=True)
class Offer:
    """A command as the rules see it."""

    epoch: int
    owner: int
    seq: int
    """Of the sample that it is based on."""
    voltage_V: float
    part_held: bool
    final: bool
    valid: bool
    fault: str = ""
    """Why it is not valid."""
    force_mN: float | None = None
    x_d_um: float | None = None
    sweep_V: float | None = None
    """Amplitude of a sweep about the voltage; None: without one."""


def sampled(limits: SafetyLimits, state: S, seq: int, x_um: float | None, now: float) -> S:
    """Note a sample of this epoch, in µm (None: no measurement), and hold it against the limits.

    An older or equal number changes nothing.
    """
    if seq <= newest_seq(state.arrivals):
        return state
    state = replace(state, arrivals=with_sample(state.arrivals, seq, now, x_um))
    if state.mode != "armed" or x_um is None:
        return state
    watches = watch_position(limits.monitors, state.watches, x_um)
    if watches is state.watches:
        return state
    found = finding(limits.monitors, watches)
    state = replace(state, watches=watches)
    return trip(limits, state, found, now) if found else state


def unheard(state: SafetyState, offer: Offer) -> str:
    """Why a command is not listened to at all; empty where it is.

    Without authority, or so far ahead of the samples that it cannot have overtaken its own.
    """
    if offer.epoch != state.epoch:
        return f"command of epoch {offer.epoch}, armed for {state.epoch}"
    if offer.owner != state.owner:
        return f"command of owner {offer.owner}, armed for {state.owner}"
    newest = newest_seq(state.arrivals)
    if offer.seq > newest + ARRIVALS_KEPT:
        return f"command {offer.seq} of the future, the newest sample is {newest}"
    return ""


def turned_away(state: S, offer: Offer, why: str) -> S:
    """Count a command that is not listened to; several of strangers are an alarm.

    One that is not valid asks for nothing: a controller says so of every sample before it is armed.
    """
    if not offer.valid:
        return state
    strangers = Strangers(state.strangers.count + 1, why)
    return replace(state, refused=state.refused + 1, refusal=why, strangers=strangers)


def early(state: SafetyState, offer: Offer) -> bool:
    """Whether a command has overtaken its sample, and must wait for it."""
    return offer.seq > newest_seq(state.arrivals)


def judged(limits: SafetyLimits, state: S, offer: Offer, now: float) -> S:
    """Take a command that is listened to, or refuse it, or trip by what it knows.

    One that is not valid is never taken; why it is not is remembered for the trip that may follow.
    """
    if why := nonsense(limits.voltage, offer.voltage_V, offer.force_mN, offer.x_d_um):
        why = f"command {offer.seq}: {why}"
        return replace(state, refused=state.refused + 1, refusal=why)
    sample = arrival_of(state.arrivals, offer.seq)
    if sample is not None:
        state = _monitored(limits, state, offer, sample.x_um, now)
    if not offer.valid:
        return replace(state, blind=offer.fault)
    # A sample that was lost on its way here is no older than the one before it.
    oldest = sample or arrival_of(state.arrivals, offer.seq - 1)
    why = objection(limits, state, offer, oldest, now)
    if why or oldest is None:
        return replace(state, refused=state.refused + 1, refusal=why)
    return _taken(limits, state, offer, oldest)


def nonsense(
    limits: VoltageLimits, voltage_V: float, force_mN: float | None, x_d_um: float | None
) -> str:
    """Why no number of a command may be used; empty where they may."""
    if why := absurd(limits, voltage_V):
        return why
    if force_mN is not None and not isfinite(force_mN):
        return f"{force_mN} mN is no force"
    if x_d_um is not None and not isfinite(x_d_um):
        return f"{x_d_um} µm is no position"
    return ""


def _monitored(limits: SafetyLimits, state: S, offer: Offer, x_um: float | None, now: float) -> S:
    """Hold force and aim against the hard limits; a freeze is released by the force alone."""
    if state.mode not in ("armed", "frozen"):
        return state
    watches = watch_command(
        limits.monitors,
        state.watches,
        seq=offer.seq,
        x_um=x_um,
        x_d_um=offer.x_d_um,
        force_mN=offer.force_mN,
    )
    state = replace(state, watches=watches)
    if state.mode == "armed":
        found = finding(limits.monitors, watches)
        return trip(limits, state, found, now) if found else state
    pressed = watches.force.found(limits.monitors.force_samples)
    return released(state, pressed, now) if pressed else state


def objection(
    limits: SafetyLimits, state: SafetyState, offer: Offer, sample: Arrival | None, now: float
) -> str:
    """Why a valid command that is listened to is not taken; empty where it may be."""
    if state.mode != "armed":
        return f"{state.mode}: {state.cause}" if state.cause else state.mode
    if offer.seq <= state.taken_seq:
        return f"command {offer.seq} after {state.taken_seq}"
    if sample is None:
        return f"command {offer.seq}: its sample was not seen here"
    if old := too_old(limits.age, state.arrivals, sample, now):
        return f"command {offer.seq}: {old}"
    if offer.sweep_V is None:
        return ""
    return too_wide(limits.voltage, offer.voltage_V, offer.sweep_V)


def _taken(limits: SafetyLimits, state: S, offer: Offer, sample: Arrival) -> S:
    """Follow a good command; ``final`` ends the arming and keeps the voltage."""
    voltage_V, flags = limited(limits.voltage, state.voltage_V, offer.voltage_V)
    return replace(
        state,
        mode="idle" if offer.final else "armed",
        voltage_V=voltage_V,
        part_held=offer.part_held,
        taken_seq=offer.seq,
        fresh_s=sample.at_s,
        limits_active=flags,
        blind="",
        excused_s=0.0,
    )
