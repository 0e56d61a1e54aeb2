"""Conditions under which the output's own watchdog receives the host's heartbeat.

A loop that hangs cannot report that it hangs. A running loop feeds the watchdog only while its
output is as the rules require. If the output does not confirm a ramp or a safe voltage, the loop
stops feeding, and the hardware goes to its own safe value. During a freeze nothing is written, and
only the heartbeat keeps the part held, so the watchdog is fed for the limited time of the freeze. A
latched actuator outputs the safe voltage and continues to feed the watchdog. With two arms, the
output of a frozen arm is not fed while the other output has not confirmed its voltage: an output
without a heartbeat releases its side of the part, and the other arm must not press alone.
"""

from pincette.control.safety.causes import Mode
from pincette.control.safety.state import SafetyLimits, SafetyState

OVERDUE = 2.0
"""Age of commands, as a multiple of the age limit. If an armed actuator has not tripped at this
age, it counts as hung."""


def may_kick_watchdog(limits: SafetyLimits, state: SafetyState, now: float) -> bool:
    """Return whether the loop may feed the watchdog."""
    if state.mode == Mode.ARMED:
        return now - state.fresh_s <= OVERDUE * limits.age.limit_s
    if state.mode == Mode.FROZEN and not (len(state.arms) > 1 and state.unconfirmed):
        return now - state.since_s <= limits.freeze_s + limits.age.limit_s
    return state.mode == Mode.IDLE or not state.unconfirmed
