"""The actuator's rules, pure: authority, age, limits, freeze, ramp, latch.

What a fault means is decided before the fault: the last good command says whether a part is held.
With the arm free the voltage ramps to the safe value; with a part held it is frozen for a bounded
time and then ramped, unless who trips it asks to let go at once. Either way the actuator is latched
until a person resets it; a reset within that time keeps the part, at the voltage that holds it.

Times count while the actuator itself runs. Where the machine has stood still, a command that is on
its way has not had its chance, and a ramp would jump; so a standstill of the actuator is left out,
up to a bound, and nothing is later by more than the standstill itself.
"""

from dataclasses import dataclass, replace
from typing import Literal

from pincette.control.planning.sweep import Sweep
from pincette.messages import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN, Command
from pincette_actuator.config import ActuatorConfig

Mode = Literal["latched", "idle", "armed", "frozen", "ramping"]

ARRIVALS_KEPT = 8


@dataclass(frozen=True, slots=True)
class State:
    """What the actuator remembers from one step to the next."""

    mode: Mode = "latched"
    cause: str = "boot"
    epoch: int = 0
    owner: int = 0
    voltage_V: float = 0.0
    part_held: bool = False
    taken_seq: int = -1
    fresh_s: float = 0.0
    """Arrival of the sample on which the last good command was based, on this program's clock."""
    arrivals: tuple[tuple[int, float], ...] = ()
    pending: Command | None = None
    """A command that has overtaken its sample."""
    answered_seq: int = -1
    since_s: float = 0.0
    """Begin of the freeze or the ramp."""
    ramp_from_V: float = 0.0
    limits_active: int = 0
    sweep: Sweep | None = None
    """What the instrument plays about ``voltage_V``."""
    blind: str = ""
    """Why the newest command is not valid; empty where it is."""
    ran_s: float | None = None
    """When the actuator ran last."""
    excused_s: float = 0.0
    """Standstill left out since the last good command."""
    standstills: int = 0
    refused: int = 0
    refusal: str = ""
    """Why a command was refused last."""

    @property
    def detail(self) -> str:
        """What a person asks for first: the mode, its cause, and the last refusal."""
        stood = f"stood still {self.standstills} times" if self.standstills else ""
        return "; ".join(text for text in (self.mode, self.cause, self.refusal, stood) if text)


def awake(config: ActuatorConfig, state: State, now: float) -> State:
    """Note that the actuator runs; a standstill before that is left out of every age."""
    if config.lockstep or state.ran_s is None:
        return replace(state, ran_s=now)
    stood_s = now - state.ran_s - config.wake_s
    if stood_s <= config.wake_s:
        return replace(state, ran_s=now)
    stood_s = min(stood_s, config.excused_s - state.excused_s)
    return replace(
        state,
        ran_s=now,
        fresh_s=state.fresh_s + stood_s,
        since_s=state.since_s + stood_s,
        excused_s=state.excused_s + stood_s,
        standstills=state.standstills + 1,
    )


def newest_sample(state: State) -> tuple[int, float]:
    """Number and arrival of the newest sample seen in this epoch."""
    return state.arrivals[-1] if state.arrivals else (-1, 0.0)


def arrival_of(state: State, seq: int) -> float | None:
    """When sample ``seq`` arrived here; None where it has not been seen."""
    for known, arrived_s in state.arrivals:
        if known == seq:
            return arrived_s
    return None


def saw(state: State, seq: int, now: float) -> State:
    """Note the arrival of a sample; older and equal numbers change nothing."""
    if seq <= newest_sample(state)[0]:
        return state
    return replace(state, arrivals=(*state.arrivals[1 - ARRIVALS_KEPT :], (seq, now)))


def refuse(state: State, reason: str) -> State:
    """Count a command that is not taken."""
    return replace(state, refused=state.refused + 1, refusal=reason)


def objection(config: ActuatorConfig, state: State, command: Command, now: float) -> str:
    """Why a command of this epoch is not taken; empty where it may be."""
    if command.owner != state.owner:
        return f"command of owner {command.owner}, armed for {state.owner}"
    if state.mode != "armed":
        return f"{state.mode}: {state.cause}" if state.cause else state.mode
    if command.seq <= state.taken_seq:
        return f"command {command.seq} after {state.taken_seq}"
    arrived_s = arrival_of(state, command.seq)
    if arrived_s is None:
        return f"command {command.seq}: its sample was not seen here"
    if now - arrived_s > config.age_limit_s:
        age_ms, limit_ms = 1e3 * (now - arrived_s), 1e3 * config.age_limit_s
        return f"command {command.seq}: {age_ms:.0f} ms old, limit {limit_ms:.0f} ms"
    return "" if command.sweep is None else _too_wide(config, command.voltage_V, command.sweep)


def _too_wide(config: ActuatorConfig, about_V: float, sweep: Sweep) -> str:
    """Why a sweep is not played; empty where it may be."""
    if sweep.amplitude_V > config.sweep_V:
        return f"sweep of ±{sweep.amplitude_V} V, limit ±{config.sweep_V} V"
    low_V, high_V = about_V - sweep.amplitude_V, about_V + sweep.amplitude_V
    if low_V < config.voltage_min_V or high_V > config.voltage_max_V:
        return (
            f"sweep from {low_V:.3f} V to {high_V:.3f} V, limits {config.voltage_min_V} V and "
            f"{config.voltage_max_V} V"
        )
    return ""


def limited(config: ActuatorConfig, state: State, wanted_V: float) -> tuple[float, int]:
    """The wanted voltage within range and slew, and which limits acted."""
    flags = 0
    if wanted_V > config.voltage_max_V:
        wanted_V, flags = config.voltage_max_V, VOLTAGE_MAX
    elif wanted_V < config.voltage_min_V:
        wanted_V, flags = config.voltage_min_V, VOLTAGE_MIN
    if wanted_V > state.voltage_V + config.slew_V:
        return state.voltage_V + config.slew_V, flags | SLEW_UP
    if wanted_V < state.voltage_V - config.slew_V:
        return state.voltage_V - config.slew_V, flags | SLEW_DOWN
    return wanted_V, flags


def take(config: ActuatorConfig, state: State, command: Command, now: float) -> State:
    """Follow a good command; ``final`` ends the arming and keeps the voltage."""
    voltage_V, flags = limited(config, state, command.voltage_V)
    arrived_s = arrival_of(state, command.seq)
    return replace(
        state,
        mode="idle" if command.final else "armed",
        voltage_V=voltage_V,
        part_held=command.part_held,
        taken_seq=command.seq,
        fresh_s=now if arrived_s is None else arrived_s,
        limits_active=flags,
        sweep=command.sweep,
        blind="",
        excused_s=0.0,
    )


def trip(
    config: ActuatorConfig, state: State, cause: str, now: float, *, let_go: bool = False
) -> State:
    """Begin the safe state, unless it has begun; the first cause is kept.

    A part is let go only where that is asked for: then a freeze ends in its ramp at once.
    """
    if state.mode == "frozen" and let_go:
        return ramped(state, now)
    if state.mode in ("frozen", "ramping") or (state.mode == "latched" and state.cause != "boot"):
        return state
    tripped = replace(state, cause=cause, since_s=now, limits_active=0, sweep=None, pending=None)
    keeps = state.part_held and not let_go
    if config.lockstep and state.mode != "armed":
        # No tick will come while nothing is armed, and the simulated plant stands still.
        return at_safe(config, tripped) if let_go else replace(tripped, mode="latched")
    return replace(tripped, mode="frozen") if keeps else ramped(tripped, now)


def ramped(state: State, now: float) -> State:
    """Begin the ramp to the safe voltage from where the voltage is."""
    return replace(state, mode="ramping", since_s=now, ramp_from_V=state.voltage_V)


def reset(config: ActuatorConfig, state: State) -> State:
    """Clear the latch; a part that is held stays so, and the voltage with it.

    In real time a ramp must have come to its end. In lockstep, where a program has died, no tick
    will come to end it.
    """
    if state.mode == "ramping":
        state = at_safe(config, state)
    return replace(state, mode="idle", cause="") if state.mode in ("latched", "frozen") else state


def at_safe(config: ActuatorConfig, state: State) -> State:
    """Be latched at the safe voltage, without a part."""
    return replace(state, mode="latched", voltage_V=config.safe_V, part_held=False)


def pass_time(config: ActuatorConfig, state: State, now: float) -> State:
    """What the mere passing of time does: the age limit, the end of a freeze, the ramp."""
    if state.mode == "armed" and now - state.fresh_s > config.age_limit_s:
        silent_ms, limit_ms = 1e3 * (now - state.fresh_s), 1e3 * config.age_limit_s
        cause = f"command_age: no command for {silent_ms:.0f} ms, limit {limit_ms:.0f} ms"
        cause = f"{cause}; {state.blind}" if state.blind else cause
        state = trip(config, state, cause, now)
    if state.mode == "frozen" and now - state.since_s >= config.freeze_s:
        state = ramped(state, now)
    if state.mode != "ramping":
        return state
    share = (now - state.since_s + 0.25 * config.period_s) / config.ramp_s
    if share >= 1.0:
        return at_safe(config, state)
    voltage_V = state.ramp_from_V + share * (config.safe_V - state.ramp_from_V)
    return replace(state, voltage_V=voltage_V)


def wind_down(config: ActuatorConfig, state: State, now: float) -> tuple[State, bool]:
    """Ramp to the safe voltage because the program is told to end, a part held or not."""
    if state.voltage_V == config.safe_V:
        return state, True
    if state.mode != "ramping":
        state = replace(
            state,
            mode="ramping",
            cause=state.cause or "shutdown",
            since_s=now,
            ramp_from_V=state.voltage_V,
            part_held=False,
            sweep=None,
            pending=None,
        )
    return state, False
