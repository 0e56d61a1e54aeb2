"""A state of the safety module, and its events, without messages."""

from pincette.control.faults import FaultCode, fault
from pincette.control.record import replace
from pincette.control.safety.admission import CommandFacts, authority_fault, judged, reject, sampled
from pincette.control.safety.arm import ArmFacts, ArmLimits
from pincette.control.safety.freshness import AgeLimits
from pincette.control.safety.latch import armed, reset
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.state import SafetyLimits, SafetyState
from pincette.control.safety.voltage import VoltageLimits
from pincette.core.wording import cause_text, faults_text

T = 0.02
EPOCH, OWNER = 11, 5
OFF = fault(FaultCode.INSTRUMENT_SILENT, "laser off")
MONITORS = MonitorLimits(
    period_s=T,
    force_mN=50.0,
    force_samples=3,
    following_um=3.0,
    following_s=0.05,
    following_samples=6,
    position_min_um=-29.0,
    position_max_um=79.0,
    position_samples=3,
)
LIMITS = SafetyLimits(
    period_s=T,
    lockstep=False,
    age=AgeLimits(limit_s=0.05, limit_ticks=2, grace_s=1.0, wake_s=T / 4, excused_s=10 * T),
    arms=(ArmLimits(VoltageLimits(min_V=-1.0, max_V=4.0, slew_V=0.5, sweep_V=0.1), MONITORS),),
    ramp_s=0.035,
    freeze_s=0.5,
    safe_V=0.0,
)
LOCKSTEP = replace(LIMITS, lockstep=True)
GOOD = CommandFacts(EPOCH, OWNER, 0, (ArmFacts(0.5),), part_held=False, final=False, valid=True)


def with_arm(state: SafetyState, **changes: object) -> SafetyState:
    """Return the state with other values of its first arm."""
    first, *others = state.arms
    return replace(state, arms=(replace(first, **changes), *others))


def command(**changes: object) -> CommandFacts:
    """Return a good command with other values of some fields, those of its arm included."""
    (arm,) = GOOD.arms
    of_arm = {name: changes.pop(name) for name in ArmFacts.__struct_fields__ if name in changes}
    return replace(GOOD, arms=(replace(arm, **of_arm),), **changes)


def ready(limits: SafetyLimits = LIMITS) -> SafetyState:
    """Return a state that was reset and armed at time 0, before the first sample."""
    return armed(limits, reset(limits, SafetyState()), epoch=EPOCH, owner=OWNER, now=0.0)


def offered(
    state: SafetyState, command: CommandFacts, now: float, limits: SafetyLimits = LIMITS
) -> SafetyState:
    """Submit a command that arrives and does not wait for its sample."""
    if why := authority_fault(state, command):
        return reject(state, command, why)
    return judged(limits, state, command, now)


def ticked(
    state: SafetyState,
    seq: int,
    limits: SafetyLimits = LIMITS,
    x_um: float = 1.0,
    **changes: object,
) -> SafetyState:
    """Submit sample ``seq`` on the grid, and 4 ms later the command computed from it."""
    state = sampled(limits, state, seq, (x_um,), seq * T)
    return offered(state, command(seq=seq, **changes), seq * T + 0.004, limits)


def held(voltage_V: float = 0.5) -> SafetyState:
    """Return an armed state with a part, after the first tick."""
    return ticked(ready(), 0, part_held=True, voltage_V=voltage_V)


def cause_words(state: SafetyState) -> str:
    """Return the cause of the trip as text."""
    return cause_text(state.cause, state.faults)


def detail_words(state: SafetyState) -> str:
    """Return the detail of the trip as text."""
    parts = (state.mode, cause_words(state), faults_text(state.findings))
    return "; ".join(part for part in parts if part)
