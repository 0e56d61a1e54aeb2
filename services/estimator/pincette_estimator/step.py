"""The estimator as a service: position k and the voltage applied at k-1 in, the force out."""

from dataclasses import dataclass, field
from math import log10
from typing import NamedTuple

from pincette.config import RigFile
from pincette.control.arm.plant import perturbation
from pincette.control.force.estimation import COVERAGE, uncertainty
from pincette.control.force.observers import ForceObserver
from pincette.control.force.to_and_fro import ToAndFro, forgotten_mN
from pincette.control.force.touch import TouchWatch
from pincette.control.force.zeroing import zero_refusal
from pincette.control.replacing import replace
from pincette.control.response.free_response import FreeResponse, FreeSample
from pincette.control.response.voltage_memory import VoltageMemory
from pincette.messages import Applied, Arm, Done, Estimate, Message, Position
from pincette.service import Drive, Input, RefusedError, Service
from pincette.topics import APPLIED, ARM, ESTIMATE, POSITION, STATUS, TIMING_OF
from pincette_estimator.config import EstimatorConfig, configure
from pincette_estimator.stuck import StuckWatch

FREE_SAMPLES = 128
"""Samples of free motion kept, enough for the branch that leads to a rest."""
TRIPPED = ("frozen", "ramping", "latched")


class Inputs(NamedTuple):
    """``applied`` is that of the sample before; None where it did not come in time."""

    position: Position | None
    applied: Applied | None


@dataclass(frozen=True, slots=True)
class State:
    """The free response in use, the samples behind it, and the past that a force needs."""

    response: FreeResponse
    """Its memory outlives an arming, as the arm's does."""
    model: FreeResponse
    """What ``response`` began as, unpoled."""
    observer: ForceObserver
    epoch: int = 0
    followed_seq: int = -1
    """The sample up to which ``response`` has followed the voltage."""
    observed_seq: int | None = None
    """The last sample that ``observer`` has seen; None before the first of an epoch."""
    samples: tuple[FreeSample, ...] = ()
    watch: TouchWatch = field(default_factory=lambda: TouchWatch(0.0, 0.0))
    """Since the zero, or the first sample of the epoch."""
    zero_s: float | None = None
    zero_refusal: str = ""
    x_2_um: float = 0.0
    x_3_um: float = 0.0
    to_and_fro: ToAndFro = field(default_factory=lambda: ToAndFro(0.0))
    """Of the voltage, since the zero."""
    highest_V: float = 0.0
    """That ``response`` has followed, ever, and"""
    known_V: float = 0.0
    """before this epoch: up to there it has the arm's memory."""
    refused: int = 0
    stuck: StuckWatch = field(default_factory=StuckWatch)
    """Whether the sensor follows the voltage at all."""
    past: VoltageMemory = field(default_factory=VoltageMemory)
    """The voltage since the start, for another model to be led through."""

    @property
    def detail(self) -> str:
        """What a person is told of this program."""
        return self.stuck.words


def start(config: EstimatorConfig) -> State:
    """Nothing has been applied and nothing measured."""
    return State(config.response, config.response, config.observer)


def step(
    config: EstimatorConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | Drive, ...]]:
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
    seq, x_um, u_V = position.seq, position.x_um, applied.voltage_V
    # Over all samples since the last that had a voltage.
    passed_s = (seq - state.followed_seq) * config.period_s
    response, past = state.response.follow(u_V, passed_s), state.past.follow(u_V, passed_s)
    to_and_fro = state.to_and_fro.follow(u_V)
    stuck = state.stuck
    if measured := position.valid and _within(config.position_um, x_um):
        stuck = stuck.follow(x_um, u_V, config.stuck_V)
    if not measured or stuck.stuck:
        state = replace(
            state,
            response=response,
            to_and_fro=to_and_fro,
            followed_seq=seq,
            stuck=stuck,
            past=past,
        )
        return state, (_degraded(config, state, position, applied),)
    t_s, first = seq * config.period_s, state.observed_seq is None
    if first:
        response = response.begin(x_um)
    free_um = response.position_um()
    nominal_um = response.nominal_um_per_V * u_V
    watch = TouchWatch(nominal_um, x_um) if first else state.watch
    watch = watch.follow(config.kink_limits, x_um, nominal_um)
    samples: tuple[FreeSample, ...] = ()
    if not applied.part_held:
        samples = (*state.samples[1 - FREE_SAMPLES :], response.sample(x_um))
    zero_s, refusal, observer = state.zero_s, state.zero_refusal, state.observer
    gap = first or seq - 1 != state.observed_seq
    if applied.zero:
        refusal = zero_refusal(
            response,
            samples,
            part_held=applied.part_held,
            limits=config.zero_limits,
            creep_um=_creep_um(config, t_s if zero_s is None else t_s - zero_s),
            touch=watch.touch,
            zeroed=zero_s is not None,
            memory_known=u_V <= state.known_V,
        )
        if not refusal:
            response = response.rezero(samples, config.zero_limits.rest_samples)
            free_um = response.position_um()
            watch, to_and_fro = TouchWatch(nominal_um, x_um), ToAndFro(u_V)
            zero_s, gap = t_s, True
    if gap:
        observer = observer.restart(x_um, free_um, u_V)
    observer, F_mN = observer.observe(x_um, free_um, u_V)
    x_2_um, x_3_um = (x_um, x_um) if first else (state.x_2_um, state.x_3_um)
    after = State(
        response,
        state.model,
        observer,
        state.epoch,
        seq,
        seq,
        samples,
        watch,
        zero_s,
        refusal,
        x_um,
        x_2_um,
        to_and_fro,
        max(state.highest_V, u_V),
        state.known_V,
        state.refused,
        stuck,
        past,
    )
    p_mN = perturbation(
        config.plant, x_um=x_um, x_1_um=x_2_um, x_2_um=x_3_um, voltage_V=u_V, force_mN=F_mN
    )
    return after, (_estimate(config, after, position, applied, F_mN, p_mN),)


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
    u_F_mN = uncertainty(
        noise_um=config.noise_um,
        free_error_um=state.response.error_um(),
        compliance_um_per_mN=config.compliance_um_per_mN,
        creep_mN_per_decade=config.creep_mN_per_decade,
        zero_age_s=t_s if age_s is None else age_s,
        forgotten_mN=forgotten_mN(
            state.to_and_fro.total_V,
            full_mN=config.forgotten_mN,
            scale_V=config.forgotten_scale_V,
        ),
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
    )


def _creep_um(config: EstimatorConfig, age_s: float) -> float:
    """How far creep may have moved the arm since a zero of this age, at two standard errors."""
    creep_mN = config.creep_mN_per_decade * log10(1.0 + max(0.0, age_s))
    return COVERAGE * creep_mN * config.compliance_um_per_mN


def _within(range_: tuple[float, float], value: float) -> bool:
    """Whether a value is a number within a range; no comparison holds of what is none."""
    return range_[0] <= value <= range_[1]


def _degraded(
    config: EstimatorConfig, state: State, position: Position, applied: Applied | None
) -> Estimate:
    """An estimate that nobody may control by: the partner or the measurement is missing."""
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
) -> str:
    """Why there is no force to be had from a sample."""
    if not position.valid:
        return f"sensor: {position.fault}"[:200]
    low_um, high_um = config.position_um
    if not low_um <= position.x_um <= high_um:
        return f"sensor: position {position.x_um:g} µm is outside {low_um:g}..{high_um:g} µm"
    return state.stuck.words or ("no voltage of the sample before" if applied is None else "")


def answer(
    config: EstimatorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch without a zero; x_1 remembers what the arm has been through.

    Another model than before is led through the same past.
    """
    if not isinstance(request, Arm):
        raise RefusedError(f"the estimator does not answer {type(request).__name__}")
    same = config.response == state.model
    begun = State(
        state.response if same else state.past.replayed(config.response),
        config.response,
        config.observer,
        epoch=request.epoch,
        to_and_fro=state.to_and_fro,
        highest_V=state.highest_V,
        known_V=state.highest_V,
        refused=state.refused,
        past=state.past,
    )
    return begun, Done(0), ()


SERVICE: Service[RigFile, EstimatorConfig, State, Inputs] = Service(
    name="estimator",
    summary="contact force (53) and perturbation (6) from position k and the voltage of k-1",
    inputs=(Input(POSITION, "trigger"), Input(APPLIED, "join", offset=-1)),
    outputs=(ESTIMATE,),
    questions=(ARM["estimator"], STATUS["estimator"], TIMING_OF["estimator"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    answer=answer,
    carried=("response", "to_and_fro", "highest_V", "known_V"),
)
