"""Conditions under which the output's own watchdog receives the host's heartbeat.

A loop that hangs cannot report it. A running loop feeds the watchdog only while its output is as
the rules require. A ramp, or a safe voltage, that the output does not confirm is left to the
hardware, which goes to its safe value when the heartbeats end. A freeze is different: it writes
nothing, and only the heartbeat keeps the part, so the watchdog is fed for the freeze's bounded
time. A latched actuator holds the safe voltage itself, and goes on feeding. With two arms, a frozen
one is not fed while the other does not confirm its voltage: an output without a heartbeat releases
its side, and the other must not be left to press alone.
"""

from pincette.control.safety.causes import Mode
from pincette.control.safety.state import SafetyLimits, SafetyState

OVERDUE = 2.0
"""Multiple of the age limit after which an armed actuator that has not tripped counts as hung."""


def may_kick_watchdog(limits: SafetyLimits, state: SafetyState, now: float) -> bool:
    """Return whether the loop may feed the watchdog."""
    if state.mode == Mode.ARMED:
        return now - state.fresh_s <= OVERDUE * limits.age.limit_s
    if state.mode == Mode.FROZEN and not (len(state.arms) > 1 and state.unconfirmed):
        return now - state.since_s <= limits.freeze_s + limits.age.limit_s
    return state.mode == Mode.IDLE or not state.unconfirmed
