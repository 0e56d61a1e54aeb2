"""The estimator as a service: position k and the voltage applied at k-1 yield the force."""

from math import fsum, inf

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.arm.plant import perturbation
from pincette.control.force.contact_detector import ContactDetector
from pincette.control.force.zeroing import zero_refusal
from pincette.control.response.free_response import FreeResponse, rest_mean
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.reversal_memory import ReversalMemory
from pincette.control.response.stroke_check import (
    MeasurementErrors,
    StrokeChange,
    corrected,
    rest_base,
    stroke_change,
)
from pincette.core.faults import TRIPPED, FaultCode, fault
from pincette.core.messages import Ack, Applied, Arm, Estimate, Message, Position
from pincette.core.service import Input, RefusedError, Service, SetVoltage
from pincette.core.topics import APPLIED, ARM, ESTIMATE, POSITION, STATUS, TIMING_OF
from pincette_estimator.both_arms import joined, moving_V
from pincette_estimator.config import ArmConfig, EstimatorConfig, configure
from pincette_estimator.following import follow_voltage, unfollowed
from pincette_estimator.state import (
    PULLS,
    ArmState,
    FreeMotion,
    Inputs,
    Pressing,
    State,
    stroke_fault,
)
from pincette_estimator.statements import degraded, estimate, force_uncertainty_mN
from pincette_estimator.uncertainty import creep_um, narrowed_past, past_creep_um, rested_past

AHEAD_SHARE = 0.5
"""Largest distance by which an arm may be ahead of its earlier zero without losing that zero, as a
fraction of the distance within which a contact is found. If an arm were ahead by more than that
distance, the force would look like a pull.
"""
KEPT_ZERO_S = 86_400.0
"""Age, in s, for which creep is allowed when a zero is compared with one of an earlier epoch."""


def start(config: EstimatorConfig) -> State:
    """Return the state before any voltage or measurement."""
    return State(
        tuple(
            ArmState(arm.response, arm.response, arm.observer, arm.unknown) for arm in config.arms
        )
    )


def step(
    config: EstimatorConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | SetVoltage, ...]]:
    """Estimate the force of one sample.

    A sample of another epoch, or with another number of arms than the rig has, is dropped and
    counted.
    """
    position, applied = inputs.position, inputs.applied
    if position is None:
        return state, ()
    refused, count = state.refused, len(config.arms)
    if position.epoch != state.epoch or len(position.arms) != count:
        return replace(state, refused=refused + 1), ()
    if applied is not None and len(applied.arms) != count:
        refused, applied = refused + 1, None
    found, apart = None, state.apart
    arms: tuple[ArmState, ...] = ()
    for of_arm, before in zip(config.arms, state.arms, strict=True):
        told = applied
        if told is not None:
            low_V, high_V = of_arm.voltage_V
            if not low_V <= told.arms[of_arm.arm].voltage_V <= high_V:
                # An impossible voltage would stay in the memory of the arm.
                refused, told = refused + 1, None
        arm, one = _estimated(of_arm, before, position, told)
        arms += (arm,)
        found = one if found is None else joined(found, one)
    if found is None:
        return state, ()
    if count == 2:
        held = applied is not None and applied.part_held
        apart = apart.updated(found, config.arms[0].period_s, held=held)
    return replace(state, arms=arms, refused=refused, apart=apart), (found,)


def _estimated(
    config: ArmConfig,
    state: ArmState,
    position: Position,
    applied: Applied | None,
) -> tuple[ArmState, Estimate]:
    """Estimate the force of one arm."""
    state = unfollowed(config, state, position.seq, applied)
    if applied is None:
        return state, degraded(config, state, position, None)
    state = follow_voltage(config, state, applied)
    sample = position.arms[config.arm]
    low_um, high_um = config.position_um
    measured = sample.valid and low_um <= sample.x_um <= high_um
    if measured:
        voltage_V, held = applied.arms[config.arm].voltage_V, False
        if config.moving is not None and applied.part_held:
            other_V = applied.arms[1 - config.arm].voltage_V
            voltage_V, held = moving_V(config.moving, voltage_V, other_V), True
        stuck = state.stuck.updated(sample.x_um, voltage_V, config.stuck_V, held=held)
        state = replace(state, stuck=stuck)
    due_V = _zero_due_V(config, state, applied)
    if not measured or state.stuck.stuck:
        state = replace(state, zero_due_V=due_V)
        return state, degraded(config, state, position, applied)
    if due_V is not None:
        applied = replace(applied, zero=True)
    if state.zero_due_V is not None:
        state = replace(state, zero_due_V=None)
    first = state.observed_seq is None
    state, F_mN, p_mN = _take_sample(config, state, position, applied)
    u_F_mN = force_uncertainty_mN(config, state, position.seq, F_mN)
    state = _check_zero(state, applied, F_mN, u_F_mN, first=first)
    if applied.step_um is not None:
        state = replace(state, step_um=applied.step_um)
    return state, estimate(config, state, position, applied, (F_mN, u_F_mN, p_mN))


def _check_zero(
    state: ArmState, applied: Applied, F_mN: float, u_F_mN: float, *, first: bool
) -> ArmState:
    """Discard a zero if an arm that a part pressed reads a pull, although no arm was opened."""
    if state.zero_s is None:
        return state
    voltage_V = fsum(arm.voltage_V for arm in applied.arms)
    before = state.pressing
    pressing = before.updated(voltage_V, F_mN, u_F_mN, held=applied.part_held, first=first)
    if pressing.pulls < PULLS:
        return state if pressing is before else replace(state, pressing=pressing)
    invalid = fault(FaultCode.ZERO_INVALID, pull_mN=-F_mN, uncertainty_mN=u_F_mN)
    return replace(state, pressing=Pressing(), zero_s=None, zero_refusal=invalid)


def _zero_due_V(config: ArmConfig, state: ArmState, applied: Applied) -> float | None:
    """Return the voltage of a zero that this sample has to take, in V; None without a zero.

    A zero whose sample was not measured stays due while the output keeps its voltage and no other
    command has been output: the arm is still in the same rest.
    """
    voltage_V = applied.arms[config.arm].voltage_V
    if applied.zero:
        return voltage_V
    moved = applied.answered or voltage_V != state.zero_due_V
    return None if moved or applied.state in TRIPPED else state.zero_due_V


def _take_sample(
    config: ArmConfig, state: ArmState, position: Position, applied: Applied
) -> tuple[ArmState, float, float]:
    """Process a measurement; return the state, the force (53) and the perturbation (6) in mN."""
    x_um, voltage_V = position.arms[config.arm].x_um, applied.arms[config.arm].voltage_V
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
        zero_confirmed=state.zero_confirmed or _found_in_place(config, state, applied, x_um, F_mN),
        observer=observer,
        observed_seq=position.seq,
        x_2_um=x_um,
        x_3_um=x_2_um,
        highest_V=max(state.highest_V, voltage_V),
    )
    return after, F_mN, p_mN


def _found_in_place(
    config: ArmConfig, state: ArmState, applied: Applied, x_um: float, F_mN: float
) -> bool:
    """Return whether the position of contact confirms that the zero was taken before the part
    pressed.

    A part that pressed at the zero is in contact as soon as the arm moves on. The force lacks the
    hidden amount, so the contact seems to begin where the zero was taken, which is before the
    planned position.
    """
    if not applied.part_held or state.zero_s is None:
        return False
    return x_um - F_mN / config.part_stiffness_mN_per_um >= config.zero_limits.first_touch_um


def _begin(config: ArmConfig, state: ArmState, x_um: float, applied: Applied) -> ArmState:
    """Put x_1 through the first sample of an epoch, unless it goes through an earlier zero.

    An earlier zero is kept while a part is held, and if the arm is at the position of that zero or
    behind it: a part may be pushing the arm back, which a new start of x_1 would hide. If the arm
    is ahead of that position by more than a zero may change, no part can have pushed it there, so
    the earlier zero was wrong.
    """
    response, limits = state.response, config.zero_limits
    if state.zero_kept:
        ahead_um = response.residual_um(response.sample(x_um))
        known = applied.arms[config.arm].voltage_V <= state.known_V
        drift_um = _drift_um(config, state, 0.0)
        most_um = limits.change_um(response, drift_um, known)
        if known:
            most_um = min(most_um, AHEAD_SHARE * limits.touch_um)
        if applied.part_held or ahead_um <= most_um:
            return state
    response = response.begin(x_um)
    unknown = state.unknown.rezero(response)
    return replace(state, response=response, unknown=unknown, zeroed=False)


def _begun_detector(
    state: ArmState, x_um: float, nominal_um: float, applied: Applied
) -> ContactDetector:
    """Begin the search for a contact at the first sample of an epoch.

    If x_1 goes through an earlier zero, the range up to this sample counts as free, so that a kink
    in it is one of the arm's own: the force then shows a part that presses the arm already. Without
    such a zero nothing shows that part, and an arm that holds a part is not free either. Such an
    arm meets the part again after it has moved back.
    """
    known = state.response.remembers and state.zeroed and not applied.part_held
    return ContactDetector(nominal_um, x_um, free_to_um=x_um if known else -inf)


def _follow_free_motion(
    config: ArmConfig, state: ArmState, x_um: float, applied: Applied
) -> ArmState:
    """Store the sample if the arm is free, and search for a contact. At the first sample, put x_1
    through it.
    """
    first = state.observed_seq is None
    # The offset of x_1 does not include its known error.
    modelled_um = x_um - state.missed_um
    state = _begin(config, state, modelled_um, applied) if first else state
    if first and not applied.part_held and (state.zero_s is not None or state.invalid_zero):
        # Both were kept for a part that is gone.
        state = replace(state, zero_s=None, zero_refusal=None)
    response = state.response
    nominal_um = response.nominal_um_per_V * applied.arms[config.arm].voltage_V
    detector = state.contact_detector
    if first:
        detector = _begun_detector(state, x_um, nominal_um, applied)
    bottom, way_base = state.bottom, state.way_base
    if isinstance(response, IdentifiedResponse) and response.strokes.bottom:
        known = state.unknown.known
        apart_um = (0.0, 0.0) if known else state.unknown.apart_um(response)
        bottom = bottom.updated(response, x_um, apart_um)
        way_base = None
    motion = FreeMotion()
    if not applied.part_held:
        motion = state.free_motion.updated(response.sample(modelled_um))
    followed = replace(
        state,
        response=response,
        bottom=bottom,
        way_base=way_base,
        contact_detector=detector.updated(config.kink_limits, x_um, nominal_um),
        free_motion=motion,
    )
    if state.unknown.awaits_rest and motion.rests(config.zero_limits.rest_samples):
        return replace(followed, unknown=rested_past(config, followed))
    return followed


def _zero(config: ArmConfig, state: ArmState, position: Position, applied: Applied) -> ArmState:
    """Zero the force at this sample, or record why it cannot be zeroed."""
    response, t_s = state.response, position.seq * config.period_s
    compared = _compare_stroke(config, state)
    refusal = zero_refusal(
        response,
        state.free_motion.samples,
        part_held=applied.part_held,
        limits=config.zero_limits,
        creep_um=_drift_um(config, state, t_s) + _stroke_um(state, compared),
        touch=state.contact_detector.touch,
        zeroed=state.zero_s is not None or state.zero_kept,
        kept=state.zero_kept,
        memory_known=applied.arms[config.arm].voltage_V <= state.known_V,
    )
    if refusal:
        return replace(state, zero_refusal=refusal)
    before = state.response
    state = _with_stroke(config, state, compared)
    if state.stroke is not None and state.stroke.refused:
        return replace(state, zero_refusal=stroke_fault(state.stroke))
    x_um, voltage_V = position.arms[config.arm].x_um, applied.arms[config.arm].voltage_V
    nominal_um = response.nominal_um_per_V * voltage_V
    response = _rezeroed(config, state, before)
    unknown = narrowed_past(config, replace(state, unknown=rested_past(config, state)), t_s)
    if isinstance(response, IdentifiedResponse) and response.conditioned:
        unknown = replace(unknown, known=True)
    return replace(
        state,
        response=response,
        unknown=unknown.rezero(response),
        contact_detector=state.contact_detector.restarted(x_um, nominal_um),
        reversal_memory=ReversalMemory(voltage_V),
        pressing=Pressing(),
        step_um=0.0,
        zero_s=t_s,
        zero_kept=False,
        zeroed=True,
        kept_age_s=0.0,
        zero_refusal=None,
    )


def _compare_stroke(config: ArmConfig, state: ArmState) -> StrokeChange | None:
    """Compare the stroke that ends at the present rest with that of the calibration.

    The stroke begins at the rest after the conditioning strokes, or, for the zero at that rest, at
    the bottom of the last conditioning stroke. Returns None if nothing can be compared.
    """
    response, count = state.response, config.zero_limits.rest_samples
    samples = state.free_motion.samples
    if not isinstance(response, IdentifiedResponse) or len(samples) < count:
        return None
    unknown_um = 0.0
    if not state.unknown.known:
        ends_um = state.unknown.apart_um(response)
        unknown_um = max(
            abs(end_um - begin_um)
            for end_um, begin_um in zip(ends_um, state.bottom.apart_um, strict=True)
        )
    doubt = MeasurementErrors(
        config.sensor_noise_um,
        config.drift_um_per_s,
        past_creep_um(config, response),
        unknown_um,
    )
    base = state.bottom.base if state.way_base is None else state.way_base
    return stroke_change(response, base, rest_mean(samples, count), count, doubt)


def _stroke_um(state: ArmState, compared: StrokeChange | None) -> float:
    """Return how far a changed stroke, which the zero corrects, has moved x_1 since the last rest.

    At the rest after the strokes the arm is compared with its last zero at that rest, so a change
    of the stroke explains no deviation: a part that presses may have shortened the motion from the
    bottom.
    """
    if compared is None or state.way_base is None:
        return 0.0
    if not compared.significant or compared.refused:
        return 0.0
    return abs(compared.change) * compared.way_um


def _with_stroke(config: ArmConfig, state: ArmState, compared: StrokeChange | None) -> ArmState:
    """Correct the stroke, and record the rest after the conditioning strokes."""
    response, count = state.response, config.zero_limits.rest_samples
    if not isinstance(response, IdentifiedResponse):
        return state
    base = state.way_base
    if base is None:
        base = rest_base(response, rest_mean(state.free_motion.samples, count), count)
    if compared is None:
        return replace(state, way_base=base)
    response = corrected(response, compared)
    return replace(state, stroke=compared, response=response, way_base=base)


def _rezeroed(config: ArmConfig, state: ArmState, before: FreeResponse) -> FreeResponse:
    """Return x_1 shifted to go through the rest at the end of the free motion.

    The displacements of that rest's samples were computed before the stroke was corrected.
    """
    response, samples = state.response, state.free_motion.samples
    count = config.zero_limits.rest_samples
    if (
        isinstance(response, IdentifiedResponse)
        and isinstance(before, IdentifiedResponse)
        and response.factor != before.factor
    ):
        scale = response.factor / before.factor
        samples = tuple(
            one._replace(displacement_um=scale * one.displacement_um) for one in samples[-count:]
        )
    return response.rezero(samples, count)


def _drift_um(config: ArmConfig, state: ArmState, t_s: float) -> float:
    """Return how far creep and the unknown history may have moved x_1 since the last zero, in µm.

    The time between two jobs is not known, and the drift of the sensor over a day could hide any
    part. The drift allowed for in that time is therefore at most the distance within which a
    contact is found.
    """
    unknown_um = state.unknown.error_um(state.response)
    if state.zero_kept:
        played_um = config.drift_um_per_s * (state.kept_age_s + t_s)
        most_um = played_um + config.zero_limits.touch_um
        return creep_um(config, KEPT_ZERO_S, most_um) + unknown_um
    age_s = t_s if state.zero_s is None else t_s - state.zero_s
    return creep_um(config, age_s) + unknown_um


def handle(
    config: EstimatorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch; x_1, also of a new model, keeps the arm's history and its offset.

    The force has no zero until the new epoch takes one. The last offset persists over the arming,
    so that a zero which would hide the force of a part is refused, however often it is repeated.
    Only ``zero_confirmed``, an operator's confirmation that nothing is in contact with the arm,
    discards it. With ``zero_kept`` the zero of the previous epoch remains valid for a part that is
    still held; that it had become invalid is reported for such a part in any case. A history that
    no program has followed stays unknown to a new model too, until a stroke has erased it.
    """
    if not isinstance(request, Arm):
        raise RefusedError(f"the estimator does not answer {type(request).__name__}")
    begun = tuple(
        _begun(of_arm, arm, request) for of_arm, arm in zip(config.arms, state.arms, strict=True)
    )
    return State(begun, request.epoch, state.refused), Ack(0), ()


def _begun(config: ArmConfig, state: ArmState, request: Arm) -> ArmState:
    same = config.response == state.model
    response = state.response if same else state.past.replayed(config.response)
    kept = (state.zero_kept or state.observed_seq is not None) and not request.zero_confirmed
    if kept and not same:
        response = response.begin(state.response.position_um())
    unknown = state.unknown if same else config.unknown.replayed(state.past)
    played_s = _played_s(config, state) if kept else 0.0
    carried = request.zero_kept and kept and same
    return ArmState(
        response,
        config.response,
        config.observer,
        unknown.judged(response),
        reversal_memory=state.reversal_memory,
        highest_V=state.highest_V,
        known_V=state.highest_V,
        zero_kept=kept,
        zeroed=kept and state.zeroed,
        zero_confirmed=request.zero_confirmed or (kept and state.zero_confirmed),
        kept_age_s=played_s,
        zero_s=-played_s if carried and state.zero_s is not None else None,
        zero_refusal=state.invalid_zero if kept else None,
        pressing=state.pressing if carried else Pressing(),
        step_um=state.step_um if carried else 0.0,
        past=state.past,
        stroke=state.stroke if same else None,
    )


def _played_s(config: ArmConfig, state: ArmState) -> float:
    """Return the time played since the last zero, in s, including earlier epochs."""
    epoch_s = (state.observed_seq or 0) * config.period_s
    return state.kept_age_s + epoch_s if state.zero_s is None else epoch_s - state.zero_s


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
    state_snapshot=("arms",),
)
