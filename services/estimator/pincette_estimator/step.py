"""The estimator as a service: position k and the voltage applied at k-1 in, the force out."""

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.arm.plant import perturbation
from pincette.control.force.contact_detector import ContactDetector
from pincette.control.force.zeroing import zero_refusal
from pincette.control.response.free_response import FreeSample
from pincette.control.response.reversal_memory import ReversalMemory
from pincette.core.faults import TRIPPED, Fault, FaultCode, fault
from pincette.core.messages import Ack, Applied, Arm, Estimate, Message, Position
from pincette.core.service import Input, RefusedError, Service, SetVoltage
from pincette.core.topics import APPLIED, ARM, ESTIMATE, POSITION, STATUS, TIMING_OF
from pincette_estimator.config import EstimatorConfig, configure
from pincette_estimator.state import Inputs, State, touched
from pincette_estimator.uncertainty import creep_um, narrowed_past, uncertainty_mN

FREE_SAMPLES = 128
"""Samples of free motion kept, enough for the branch that leads to a rest."""


def start(config: EstimatorConfig) -> State:
    """Nothing has been applied and nothing measured."""
    return State(config.response, config.response, config.observer, config.unknown)


def step(
    config: EstimatorConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | SetVoltage, ...]]:
    """Estimate the force of one sample; a sample of another epoch is dropped and counted."""
    position, applied = inputs.position, inputs.applied
    if position is None:
        return state, ()
    if position.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    if applied is not None and not _within(config.voltage_V, applied.voltage_V):
        # Followed once, it would stay in the memory of the arm.
        state, applied = replace(state, refused=state.refused + 1), None
    if applied is None:
        return state, (_degraded(config, state, position, None),)
    state = _follow_voltage(config, state, position.seq, applied.voltage_V)
    state = _follow_program(config, state, applied)
    measured = position.valid and _within(config.position_um, position.x_um)
    if measured:
        stuck = state.stuck.follow(position.x_um, applied.voltage_V, config.stuck_V)
        state = replace(state, stuck=stuck)
    if not measured or state.stuck.stuck:
        return state, (_degraded(config, state, position, applied),)
    state, F_mN, p_mN = _take_sample(config, state, position, applied)
    return state, (_estimate(config, state, position, applied, F_mN, p_mN),)


def _follow_voltage(config: EstimatorConfig, state: State, seq: int, voltage_V: float) -> State:
    """Take in the voltage applied, over all samples since the last that had one."""
    passed_s = (seq - state.followed_seq) * config.period_s
    return replace(
        state,
        response=state.response.follow(voltage_V, passed_s),
        past=state.past.follow(voltage_V, passed_s),
        unknown=state.unknown.follow(voltage_V, passed_s),
        reversal_memory=state.reversal_memory.follow(voltage_V),
        followed_seq=seq,
    )


def _follow_program(config: EstimatorConfig, state: State, applied: Applied) -> State:
    """Take up what x_1 misses at the tick that the voltage is of; without one it stays."""
    if config.residual is None or applied.segment is None:
        return state
    return replace(state, missed=config.residual.at(applied.segment, applied.segment_tick))


def _take_sample(
    config: EstimatorConfig, state: State, position: Position, applied: Applied
) -> tuple[State, float, float]:
    """Take in a measurement; the next state, the force (53) and the perturbation (6) in mN."""
    x_um, voltage_V = position.x_um, applied.voltage_V
    first = state.observed_seq is None
    missed = state.observed_seq != position.seq - 1
    state = _follow_free_motion(config, state, x_um, applied)
    if applied.zero:
        state = _zero(config, state, position, applied)
    zeroed = applied.zero and not state.zero_refusal
    observer = state.observer
    free_um = state.response.position_um() + state.missed_um
    if first or missed or zeroed:
        observer = observer.restart(x_um, free_um, voltage_V)
    observer, F_mN = observer.observe(x_um, free_um, voltage_V)
    x_2_um, x_3_um = (x_um, x_um) if first else (state.x_2_um, state.x_3_um)
    p_mN = perturbation(
        config.plant, x_um=x_um, x_1_um=x_2_um, x_2_um=x_3_um, voltage_V=voltage_V, force_mN=F_mN
    )
    after = replace(
        state,
        observer=observer,
        observed_seq=position.seq,
        x_2_um=x_um,
        x_3_um=x_2_um,
        highest_V=max(state.highest_V, voltage_V),
    )
    return after, F_mN, p_mN


def _follow_free_motion(
    config: EstimatorConfig, state: State, x_um: float, applied: Applied
) -> State:
    """Keep the sample if the arm is free, and look for a contact; the first one begins x_1."""
    first = state.observed_seq is None
    # What x_1 is known to miss is no matter of its offset.
    modelled_um = x_um - state.missed_um
    response = state.response.begin(modelled_um) if first else state.response
    nominal_um = response.nominal_um_per_V * applied.voltage_V
    detector = state.contact_detector
    if first:
        detector = ContactDetector(nominal_um, x_um, free_to_um=x_um)
    samples: tuple[FreeSample, ...] = ()
    if not applied.part_held:
        samples = (*state.samples[1 - FREE_SAMPLES :], response.sample(modelled_um))
    return replace(
        state,
        response=response,
        unknown=state.unknown.rezero(response) if first else state.unknown,
        contact_detector=detector.follow(config.kink_limits, x_um, nominal_um),
        samples=samples,
    )


def _zero(config: EstimatorConfig, state: State, position: Position, applied: Applied) -> State:
    """Zero the force at this sample, or note why it cannot be zeroed."""
    response, t_s = state.response, position.seq * config.period_s
    refusal = zero_refusal(
        response,
        state.samples,
        part_held=applied.part_held,
        limits=config.zero_limits,
        creep_um=creep_um(config, t_s if state.zero_s is None else t_s - state.zero_s)
        + state.unknown.error_um(response),
        touch=state.contact_detector.touch,
        zeroed=state.zero_s is not None,
        memory_known=applied.voltage_V <= state.known_V,
    )
    if refusal:
        return replace(state, zero_refusal=refusal)
    nominal_um = response.nominal_um_per_V * applied.voltage_V
    return replace(
        state,
        response=response.rezero(state.samples, config.zero_limits.rest_samples),
        unknown=narrowed_past(config, state, t_s).rezero(response),
        contact_detector=state.contact_detector.restarted(position.x_um, nominal_um),
        reversal_memory=ReversalMemory(applied.voltage_V),
        zero_s=t_s,
        zero_refusal=None,
    )


def _estimate(
    config: EstimatorConfig,
    state: State,
    position: Position,
    applied: Applied,
    F_mN: float,
    p_mN: float,
) -> Estimate:
    """State the force of the sample just taken in, and its uncertainty."""
    t_s = position.seq * config.period_s
    age_s = None if state.zero_s is None else t_s - state.zero_s
    u_F_mN = uncertainty_mN(config, state, t_s if age_s is None else age_s)
    touch_x_um, touch_mN = touched(
        state,
        compliance_um_per_mN=config.compliance_um_per_mN,
        step_um=config.kink_limits.step_um,
        x_um=position.x_um,
        F_mN=F_mN,
        u_F_mN=u_F_mN,
    )
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        x_um=position.x_um,
        force_mN=F_mN,
        force_uncertainty_mN=u_F_mN,
        perturbation_mN=p_mN,
        zero_age_s=age_s,
        zero_refusal=state.zero_refusal,
        applied_V=applied.voltage_V,
        applied_seq=applied.seq,
        limits_active=applied.limits_active,
        tripped=applied.state in TRIPPED,
        degraded=False,
        valid=True,
        touch_x_um=touch_x_um,
        touch_mN=touch_mN,
    )


def _within(range_: tuple[float, float], value: float) -> bool:
    """Whether a value is a number within a range; no comparison holds of what is none."""
    return range_[0] <= value <= range_[1]


def _degraded(
    config: EstimatorConfig, state: State, position: Position, applied: Applied | None
) -> Estimate:
    """An estimate that must not be used for control: the voltage or the measurement is missing."""
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        x_um=position.x_um if _within(config.position_um, position.x_um) else 0.0,
        force_mN=0.0,
        force_uncertainty_mN=0.0,
        perturbation_mN=0.0,
        zero_age_s=None,
        zero_refusal=state.zero_refusal,
        applied_V=state.response.voltage_V if applied is None else applied.voltage_V,
        applied_seq=-1 if applied is None else applied.seq,
        limits_active=0 if applied is None else applied.limits_active,
        tripped=applied is not None and applied.state in TRIPPED,
        degraded=applied is None,
        valid=False,
        fault=_fault(config, state, position, applied),
    )


def _fault(
    config: EstimatorConfig, state: State, position: Position, applied: Applied | None
) -> Fault | None:
    """Why there is no force to be had from a sample."""
    if not position.valid:
        return position.fault
    low_um, high_um = config.position_um
    if not low_um <= position.x_um <= high_um:
        return fault(
            FaultCode.POSITION_OUT_OF_RANGE,
            x_um=position.x_um,
            minimum_um=low_um,
            maximum_um=high_um,
        )
    if stuck := state.stuck.fault:
        return stuck
    return fault(FaultCode.NO_APPLIED_VOLTAGE) if applied is None else None


def handle(
    config: EstimatorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch without a zero; x_1, and a new model of it, keeps the arm's past.

    What nobody has followed stays unknown to a new model too, until a stroke has wiped it out.
    """
    if not isinstance(request, Arm):
        raise RefusedError(f"the estimator does not answer {type(request).__name__}")
    same = config.response == state.model
    response = state.response if same else state.past.replayed(config.response)
    unknown = state.unknown if same else config.unknown.led_through(state.past)
    begun = State(
        response,
        config.response,
        config.observer,
        unknown.judged(response),
        epoch=request.epoch,
        reversal_memory=state.reversal_memory,
        highest_V=state.highest_V,
        known_V=state.highest_V,
        refused=state.refused,
        past=state.past,
    )
    return begun, Ack(0), ()


SERVICE: Service[RigFile, EstimatorConfig, State, Inputs] = Service(
    name="estimator",
    summary="contact force (53) and perturbation (6) from position k and the voltage of k-1",
    inputs=(Input(POSITION, "trigger"), Input(APPLIED, "join", offset=-1)),
    outputs=(ESTIMATE,),
    requests=(ARM["estimator"], STATUS["estimator"], TIMING_OF["estimator"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    handle=handle,
    state_snapshot=("response", "unknown", "reversal_memory", "highest_V", "known_V"),
)
