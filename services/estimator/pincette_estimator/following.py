"""How the arm's memories follow a voltage: as a sample asks for it, or ahead of the sample.

What is worked out ahead is kept beside the state with what it was made of. A step takes it only
where that is still the same, so that it changes no number.
"""

from msgspec.structs import replace

from pincette.control.response.free_response import FreeResponse
from pincette.control.response.residual_table import Residual
from pincette.control.response.voltage_memory import VoltageMemory
from pincette.core.faults import Cause
from pincette.core.messages import Applied, Estimate, Message
from pincette_estimator.config import ArmConfig, EstimatorConfig
from pincette_estimator.state import ArmState, Followed, Foreseen, Ringing, State
from pincette_estimator.statements import within
from pincette_estimator.uncertainty import uncertainty_mN

OUTPUT_LOST = (Cause.DEVICE, Cause.SUSPEND)
"""Causes of a trip in which the actuator had to ask the output for its voltage."""
UNHEARD_S = 0.5
"""Time without a message of the actuator after which somebody else may have moved the output: less
than a restart takes, more than lost messages cause."""


def ahead(config: EstimatorConfig, state: State, told: Message) -> State:
    """Catch up with what an estimate did not wait for; lead the memories by a voltage as soon as
    it is applied, before the sample after it."""
    arms: tuple[ArmState, ...] = ()
    if isinstance(told, Estimate):
        for arm in state.arms:
            arms += (arm.caught_up(),)
        return replace(state, arms=arms)
    if not isinstance(told, Applied) or told.epoch != state.epoch:
        return state
    if len(told.arms) != len(config.arms):
        return state
    for of_arm, arm in zip(config.arms, state.arms, strict=True):
        arms += (_led_ahead(of_arm, arm, told),)
    return replace(state, arms=arms)


def _led_ahead(config: ArmConfig, state: ArmState, applied: Applied) -> ArmState:
    voltage_V = applied.arms[config.arm].voltage_V
    if not within(config.voltage_V, voltage_V) or applied.seq < state.followed_seq:
        return state
    followed, seq = _followed(config, state, applied), applied.seq + 1
    missed = _missed(config, state, applied)
    u_F_mN = uncertainty_mN(config, followed, missed, state.zero_s, seq)
    foreseen = Foreseen(u_F_mN, seq, (followed.response, followed.unknown))
    return replace(state, followed=followed, foreseen=foreseen)


def _followed(config: ArmConfig, state: ArmState, applied: Applied) -> Followed:
    """Return what a voltage makes of the memories, over all samples since the last that had one."""
    voltage_V = applied.arms[config.arm].voltage_V
    passed_s = (applied.seq + 1 - state.followed_seq) * config.period_s
    response = state.response.follow(voltage_V, passed_s)
    return Followed(
        response,
        state.past.follow(voltage_V, passed_s),
        state.unknown.follow(voltage_V, passed_s),
        state.reversal_memory.follow(voltage_V),
        _ringing(config, state, response, applied),
        (applied, state.response, state.unknown),
    )


def _ringing(
    config: ArmConfig, state: ArmState, response: FreeResponse, applied: Applied
) -> Ringing:
    """Add the ring that a step of the free position excites to the ring of earlier steps."""
    shares = config.ring_shares
    if shares.free == 0.0:
        return state.ringing
    step_um = response.position_um() - state.response.position_um()
    return Ringing(abs(step_um) + shares.kept * state.ringing.free_um, applied.part_held)


def unfollowed(config: ArmConfig, state: ArmState, seq: int, applied: Applied | None) -> ArmState:
    """Forget the arm's past where its voltage was not known: it may have been anywhere within the
    limits, and goes straight from there to the next one that is told."""
    lost = (seq - state.followed_seq) * config.period_s > UNHEARD_S
    if applied is not None:
        lost = lost or applied.unconfirmed or applied.cause in OUTPUT_LOST
        if state.followed_seq < 0:
            moved_V = abs(applied.arms[config.arm].voltage_V - state.response.voltage_V)
            lost = lost or moved_V > config.unseen_V
    if not lost or state.unknown is config.unknown:
        return state
    return replace(state, unknown=config.unknown, past=VoltageMemory(), highest_V=0.0, known_V=0.0)


def follow_voltage(config: ArmConfig, state: ArmState, applied: Applied) -> ArmState:
    """Take in the voltage applied, as it may have been followed ahead, and its tick."""
    found = state.followed
    if (
        found is None
        or found.of[0] is not applied
        or found.of[1] is not state.response
        or found.of[2] is not state.unknown
    ):
        found = _followed(config, state, applied)
    return replace(
        state,
        missed=_missed(config, state, applied),
        response=found.response,
        past=found.past,
        unknown=found.unknown,
        reversal_memory=found.reversal_memory,
        ringing=found.ringing,
        followed_seq=applied.seq + 1,
        followed=None,
    )


def _missed(config: ArmConfig, state: ArmState, applied: Applied) -> Residual | None:
    """Return what x_1 misses at the tick that the voltage is of; without one it stays."""
    if config.residual is None or applied.segment is None:
        return state.missed
    return config.residual.at(applied.segment, applied.segment_tick)
