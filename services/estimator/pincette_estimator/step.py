"""The estimator as a service: position k and the voltage applied at k-1 in, the force out."""

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import NamedTuple

from pincette.config import RigFile
from pincette.control.force import force, uncertainty, zero_refusal
from pincette.control.free_response import FreeResponse, FreeSample
from pincette.control.plant import perturbation
from pincette.control.to_and_fro import ToAndFro, forgotten_mN
from pincette.messages import Applied, Arm, Done, Estimate, Message, Position
from pincette.service import Drive, Input, RefusedError, Service
from pincette.topics import APPLIED, ARM, ESTIMATE, POSITION, STATUS
from pincette_estimator.config import EstimatorConfig, configure

FREE_SAMPLES = 128
"""Samples of free motion kept, enough for the branch that leads to a rest."""
TRIPPED = ("frozen", "ramping", "latched")


class Inputs(NamedTuple):
    """``applied`` is that of the sample before; None where it did not come in time."""

    position: Position | None
    applied: Applied | None


@dataclass(frozen=True, slots=True)
class State:
    """The free response in use, the samples behind it, and the past the perturbation needs."""

    response: FreeResponse
    """Its memory outlives an arming, as the arm's does."""
    epoch: int = 0
    followed_seq: int = -1
    """The sample up to which ``response`` has followed the voltage."""
    begun: bool = False
    """Whether x_1 has been put to a position in this epoch."""
    samples: tuple[FreeSample, ...] = ()
    zero_s: float | None = None
    zero_refusal: str = ""
    x_2_um: float = 0.0
    x_3_um: float = 0.0
    force_mN: float | None = None
    """F̂ of the sample before, low-passed; None where it begins anew."""
    to_and_fro: ToAndFro = field(default_factory=lambda: ToAndFro(0.0))
    """Of the voltage, since the zero."""
    refused: int = 0


def start(config: EstimatorConfig) -> State:
    """Nothing has been applied and nothing measured."""
    return State(config.response)


def step(
    config: EstimatorConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | Drive, ...]]:
    """Estimate the force of one sample; a sample of another epoch is dropped and counted."""
    position, applied = inputs.position, inputs.applied
    if position is None:
        return state, ()
    if position.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    if applied is None or not isfinite(applied.voltage_V):
        return state, (_degraded(state, position, None),)
    state = _follow(config, state, position.seq, applied.voltage_V)
    if not position.valid or not isfinite(position.x_um):
        return state, (_degraded(state, position, applied),)
    state = _begin(state, position.x_um)
    x_um, u_V = position.x_um, applied.voltage_V
    t_s = position.seq * config.period_s
    state = _listen(config, state, x_um, applied, t_s)
    F_mN = force(x_um, state.response.position_um(), config.compliance_um_per_mN)
    if state.force_mN is not None:
        F_mN = state.force_mN + config.smoothing * (F_mN - state.force_mN)
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
    p_mN = perturbation(
        config.plant,
        x_um=x_um,
        x_1_um=state.x_2_um,
        x_2_um=state.x_3_um,
        voltage_V=u_V,
        force_mN=F_mN,
    )
    estimate = Estimate(
        epoch=position.epoch,
        seq=position.seq,
        x_um=x_um,
        force_mN=F_mN,
        force_uncertainty_mN=u_F_mN,
        perturbation_mN=p_mN,
        zero_age_s=age_s,
        zero_refusal=state.zero_refusal,
        applied_V=u_V,
        applied_seq=applied.seq,
        limits_active=applied.limits_active,
        tripped=applied.state in TRIPPED,
        degraded=False,
        valid=True,
    )
    after = replace(state, x_2_um=x_um, x_3_um=state.x_2_um, force_mN=F_mN)
    return after, (estimate,)


def _follow(config: EstimatorConfig, state: State, seq: int, voltage_V: float) -> State:
    """Let x_1 follow the voltage over the samples since the last that had one."""
    dt_s = (seq - state.followed_seq) * config.period_s
    return replace(
        state,
        response=state.response.follow(voltage_V, dt_s),
        to_and_fro=state.to_and_fro.follow(voltage_V),
        followed_seq=seq,
    )


def _begin(state: State, x_um: float) -> State:
    """Start an epoch from the first position measured in it."""
    if state.begun:
        return state
    response = state.response.begin(x_um)
    return replace(state, response=response, begun=True, x_2_um=x_um, x_3_um=x_um)


def _listen(
    config: EstimatorConfig, state: State, x_um: float, applied: Applied, t_s: float
) -> State:
    """Keep samples of free motion, and zero on them where the command of k-1 asked for it."""
    if applied.part_held:
        samples: tuple[FreeSample, ...] = ()
    else:
        samples = (*state.samples[1 - FREE_SAMPLES :], state.response.sample(x_um))
    if not applied.zero:
        return replace(state, samples=samples)
    limits = config.zero_limits
    refusal = zero_refusal(state.response, samples, part_held=applied.part_held, limits=limits)
    if refusal:
        return replace(state, samples=samples, zero_refusal=refusal)
    response = state.response.rezero(samples, limits.rest_samples)
    return replace(
        state,
        samples=samples,
        response=response,
        zero_s=t_s,
        zero_refusal="",
        force_mN=None,
        to_and_fro=ToAndFro(state.to_and_fro.voltage_V),
    )


def _degraded(state: State, position: Position, applied: Applied | None) -> Estimate:
    """An estimate that nobody may control by: the partner or the measurement is missing."""
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        x_um=position.x_um,
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
    )


def answer(
    _config: EstimatorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch without a zero; x_1 remembers what the arm has been through."""
    if not isinstance(request, Arm):
        raise RefusedError(f"the estimator does not answer {type(request).__name__}")
    begun = State(
        state.response,
        epoch=request.epoch,
        to_and_fro=state.to_and_fro,
        refused=state.refused,
    )
    return begun, Done(0), ()


SERVICE: Service[RigFile, EstimatorConfig, State, Inputs] = Service(
    name="estimator",
    summary="contact force (53) and perturbation (6) from position k and the voltage of k-1",
    inputs=(Input(POSITION, "trigger"), Input(APPLIED, "join", offset=-1)),
    outputs=(ESTIMATE,),
    questions=(ARM["estimator"], STATUS["estimator"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    answer=answer,
)
