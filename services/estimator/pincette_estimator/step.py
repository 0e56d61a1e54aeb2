"""The estimator as a service: position k and the voltage applied at k-1 in, the force out."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from pincette.config import RigFile
from pincette.control.force import force, uncertainty, zero_refusal
from pincette.control.free_response import (
    FreeResponse,
    FreeSample,
    free_position,
    nominal_response,
    relinearize,
)
from pincette.control.plant import perturbation
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

    epoch: int = 0
    response: FreeResponse | None = None
    samples: tuple[FreeSample, ...] = ()
    zero_s: float | None = None
    zero_refusal: str = ""
    x_2_um: float = 0.0
    x_3_um: float = 0.0
    voltage_V: float = 0.0
    refused: int = 0


def start(_config: EstimatorConfig) -> State:
    """Nothing is known before the first sample."""
    return State()


def step(
    config: EstimatorConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | Drive, ...]]:
    """Estimate the force of one sample; a sample of another epoch is dropped and counted."""
    position, applied = inputs.position, inputs.applied
    if position is None:
        return state, ()
    if position.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    if applied is None or not position.valid:
        return _degraded(state, position, applied)
    x_um, u_V = position.x_um, applied.voltage_V
    t_s = position.seq * config.period_s
    if state.response is None:
        response = nominal_response(config.piezo_um_per_V, FreeSample(u_V, x_um))
        state = replace(state, response=response, x_2_um=x_um, x_3_um=x_um)
    state = _listen(config, state, FreeSample(u_V, x_um), applied, t_s)
    response = state.response
    if response is None:
        return state, ()
    free_um = free_position(response, u_V)
    F_mN = force(x_um, free_um, config.compliance_um_per_mN)
    age_s = None if state.zero_s is None else t_s - state.zero_s
    u_F_mN = uncertainty(
        noise_um=config.noise_um,
        compliance_um_per_mN=config.compliance_um_per_mN,
        piezo_um_per_V=response.gain_um_per_V,
        hysteresis_fraction=config.hysteresis_fraction,
        travel_V=abs(u_V - response.zero_V),
        creep_mN_per_decade=config.creep_mN_per_decade,
        zero_age_s=t_s if age_s is None else age_s,
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
    return replace(state, x_2_um=x_um, x_3_um=state.x_2_um, voltage_V=u_V), (estimate,)


def _listen(
    config: EstimatorConfig, state: State, sample: FreeSample, applied: Applied, t_s: float
) -> State:
    """Keep samples of free motion, and zero on them where the command of k-1 asked for it."""
    if applied.part_held:
        samples: tuple[FreeSample, ...] = ()
    else:
        samples = (*state.samples[1 - FREE_SAMPLES :], sample)
    if not applied.zero or state.response is None:
        return replace(state, samples=samples)
    limits = config.zero_limits
    refusal = zero_refusal(state.response, samples, part_held=applied.part_held, limits=limits)
    if refusal:
        return replace(state, samples=samples, zero_refusal=refusal)
    response = relinearize(state.response, samples, rest_samples=limits.rest_samples)
    return replace(state, samples=samples, response=response, zero_s=t_s, zero_refusal="")


def _degraded(
    state: State, position: Position, applied: Applied | None
) -> tuple[State, tuple[Message | Drive, ...]]:
    """An estimate that nobody may control by: the partner or the measurement is missing."""
    estimate = Estimate(
        epoch=position.epoch,
        seq=position.seq,
        x_um=position.x_um,
        force_mN=0.0,
        force_uncertainty_mN=0.0,
        perturbation_mN=0.0,
        zero_age_s=None,
        zero_refusal=state.zero_refusal,
        applied_V=state.voltage_V if applied is None else applied.voltage_V,
        applied_seq=-1 if applied is None else applied.seq,
        limits_active=0 if applied is None else applied.limits_active,
        tripped=applied is not None and applied.state in TRIPPED,
        degraded=applied is None,
        valid=False,
    )
    return state, (estimate,)


def answer(
    _config: EstimatorConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Begin a new epoch with nothing known."""
    if not isinstance(request, Arm):
        raise RefusedError(f"the estimator does not answer {type(request).__name__}")
    return State(epoch=request.epoch, refused=state.refused), Done(0), ()


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
