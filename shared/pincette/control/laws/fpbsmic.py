"""PBSMIC with a filtered perturbation: a law for periods of a few ms or less.

At a short period the p̂_k = p_{k-1} of PBSMIC, which is one sample late, contains the whole
vibration of the mode, and backward differences of x are mostly noise. Here the perturbation is
filtered by n equal poles, the prediction is quasi-static, and the planned motion passes through the
model in advance. Symbols: displacement H of the free response; S = 1 + κ_e with κ_e = s_p·K_e of
the contact in the plan (0 if free); φ = max(0, δ - 1/2), where δT is the time from a sample to the
output of its voltage.

    x̄_1,k  = (1-φ)·H_k + φ·H_{k-1}              of the age of x_k: delay and half a hold        F2
    l(t)   = 2ζ/ω_n·ẋ_r + ẍ_r/ω_n²              by which x_1 leads x, from the plan
    W_k    = S·x_k - κ_e·x_e - x̄_1,k            the perturbation as a displacement, p/k         F3
    Ŵ_k    = F(z) W_k,   F = [(1-p)/(1-p·z⁻¹)]ⁿ,   p = e^(-2π·f_w·T)                            F4
    x_ff   = x_d(t) + l(t)/S   at t = (k + δ + 1/2)T                                            F5
    u_k    = H⁻¹[ S·x_ff - κ_e·x_e - Ŵ_k ]                                                      F6
    F̂ - F_r = F(z)[ (x̄_1 - x - l)/s_p - F_r ]   x_d by (16), of this error low-passed at f_F    F7

W is S times the perturbation w of the position, so that a better K_e changes no state. When a
contact begins or ends in the plan, F4 may already contain the force. Its stages are then shifted so
that H(u) continues with the change T·ẋ_r. If a lag τ acts between output and arm, x̄_1 is filtered
by it too, and F5 leads by a further τ·ẋ_r.

Relation to sliding modes: for n = 1, s_k = p·e_k + (1-p)·Σe is W_k/S minus its initial value, and p
= K_P/(K_P + K_I) gives the reaching law of PBSMIC. For n > 1 the sliding motion is that of F(z).
Equation numbers without F are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, pi

from pincette.control.arm.plant import DifferenceEquation, continuous
from pincette.control.force.observers import held_age, kept
from pincette.control.laws.definition import LawDefinition
from pincette.control.laws.history import History
from pincette.control.laws.impedance import (
    IMPEDANCE_GAINS,
    DiscreteImpedance,
    desired_position,
    discrete_impedance_of,
    impedance_of,
)
from pincette.control.laws.parameters import LawParameter
from pincette.control.laws.planned_motion import PlannedMotion
from pincette.control.laws.sliding import LawOutput
from pincette.control.record import FrozenRecord, replace

MOST_POLES, LATEST = 4, 1.5
"""Largest number of poles, and longest delay in periods. A voltage with a longer delay has no
effect on the next sample but one."""


@dataclass(frozen=True, slots=True)
class FpbsmicParameters:
    """Model of the arm, filters and impedance."""

    period_s: float
    um_per_V: float
    """Gain d/k of the arm, in µm/V."""
    compliance_um_per_mN: float
    """Compliance s_p of the arm, in µm/mN."""
    lead_s: float
    """Coefficient 2ζ/ω_n of the lead l, in s."""
    lead_s2: float
    """Coefficient 1/ω_n² of the lead l, in s²."""
    older: float
    """Weight φ of the previous free response."""
    ahead_s: float
    """Time φT from the next sample to the instant for which u_k is chosen, in s."""
    lag_s: float
    """Time constant τ of a lag between output and arm, in s."""
    lag_kept: float
    """Factor e^(-T/τ) of the lag over one period; 0 without a lag."""
    poles: "Cascade"
    """Pole p of each stage of F(z); 0 for stages beyond n."""
    force_share: float
    """Weight of each new sample in the low-pass of the force error."""
    impedance: DiscreteImpedance


class Cascade(FrozenRecord, frozen=True):
    """One number for each stage of the filter F(z)."""

    one: float
    two: float
    three: float
    four: float


class FpbsmicState(FrozenRecord, frozen=True):
    """State of the law before the tick that computes u_k."""

    history: History
    fresh: float
    """1 before the first step, in which the perturbation is not filtered; otherwise 0."""
    rebased: float
    """1 before a step with a changed contact, otherwise 0; see ``rebase``."""
    x_d_um: float
    """Desired position x_{d,k} of the newest sample, in µm."""
    deviation_1_um: float
    """Deviation x_d - x_r of the newest sample, in µm."""
    deviation_2_um: float
    """Deviation x_d - x_r of the previous sample, in µm."""
    lead_um: float
    """Lead l_k in µm."""
    lagging_um: float
    """Lagged free response x̄_1 of the previous sample, in µm."""
    begun_um: float
    """Initial perturbation W, from which the sliding function is counted, in µm."""
    perturbation_um: Cascade
    """Stages of the filter F4, in µm; the last one is Ŵ_{k-1}."""
    force_error_mN: Cascade
    """Stages of the filter F7, in mN."""
    slow_error_mN: float
    """Low-passed F̂ - F_r, in mN."""


def build(
    plant: DifferenceEquation, gains: Mapping[str, float], period_s: float
) -> FpbsmicParameters:
    """Build the filters; raises ValueError for an impossible order or too long a delay."""
    poles = gains["n"]
    if poles not in range(1, MOST_POLES + 1):
        raise ValueError(f"n = {poles:g}, must be a whole number of poles from 1 to {MOST_POLES}")
    output = plant.output
    delay = output.delay_s / period_s
    if delay > LATEST:
        raise ValueError(
            f"a delay of {1000.0 * output.delay_s:.3g} ms from sample to voltage is above "
            f"{LATEST:g} periods of {1000.0 * period_s:.3g} ms: choose a longer period"
        )
    arm = continuous(plant, period_s)
    p = exp(-2.0 * pi * gains["f_w"] * period_s)
    older = held_age(delay)
    return FpbsmicParameters(
        period_s=period_s,
        um_per_V=arm.d / arm.k,
        compliance_um_per_mN=1.0 / arm.k,
        lead_s=arm.b / arm.k,
        lead_s2=arm.m / arm.k,
        older=older,
        ahead_s=older * period_s,
        lag_s=output.lag_s,
        lag_kept=kept(period_s, output.lag_s),
        poles=Cascade(*(p if stage < poles else 0.0 for stage in range(MOST_POLES))),
        force_share=1.0 - exp(-2.0 * pi * gains["f_F"] * period_s),
        impedance=discrete_impedance_of(gains, period_s),
    )


def start(
    _parameters: FpbsmicParameters,
    history: History,
    *,
    x_um: float,
    x_r_um: float,
    force_error_mN: float,  # noqa: ARG001  the filter takes it up from 0
) -> FpbsmicState:
    """Return the state for a bumpless start: the next step keeps the voltage if x_r = x."""
    zero = Cascade(0.0, 0.0, 0.0, 0.0)
    return FpbsmicState(
        history=history,
        fresh=1.0,
        rebased=0.0,
        x_d_um=x_um,
        deviation_1_um=x_um - x_r_um,
        deviation_2_um=x_um - x_r_um,
        lead_um=0.0,
        lagging_um=0.0,
        begun_um=0.0,
        perturbation_um=zero,
        force_error_mN=zero,
        slow_error_mN=0.0,
    )


def rebase(state: FpbsmicState) -> FpbsmicState:
    """Mark that the contact begins or ends, so that the next step avoids a jump of the voltage."""
    return replace(state, rebased=1.0)


def moved(state: Cascade, by: float) -> Cascade:
    """Return all stages shifted by the same distance."""
    return Cascade(state.one + by, state.two + by, state.three + by, state.four + by)


def passed(poles: Cascade, state: Cascade, value: float) -> Cascade:
    """Return the stages of F(z) after a sample: s ← p·s + (1-p)·(the previous stage)."""
    one = poles.one * state.one + (1.0 - poles.one) * value
    two = poles.two * state.two + (1.0 - poles.two) * one
    three = poles.three * state.three + (1.0 - poles.three) * two
    four = poles.four * state.four + (1.0 - poles.four) * three
    return Cascade(one, two, three, four)


def step(
    parameters: FpbsmicParameters,
    state: FpbsmicState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,  # noqa: ARG001  the model follows the applied voltage: nothing winds up
    plan: PlannedMotion,
) -> tuple[FpbsmicState, LawOutput]:
    """Compute u_k; the arguments are as in ``pbsmic.step``, ``plan`` belongs to ``x_r_um``."""
    k = parameters
    kappa = k.compliance_um_per_mN * plan.K_e_mN_per_um
    stiffer, touch_um = 1.0 + kappa, kappa * plan.x_e_um
    free_um = k.um_per_V * ((1.0 - k.older) * applied_V + k.older * state.history.applied_V)
    fresh = state.fresh > 0.5
    if not fresh:
        free_um = (1.0 - k.lag_kept) * free_um + k.lag_kept * state.lagging_um
    found_um = stiffer * x_um - touch_um - free_um
    if fresh:
        begun_um = before_um = found_um
        filtered = Cascade(found_um, found_um, found_um, found_um)
    else:
        begun_um, before_um = state.begun_um, state.perturbation_um.four
        filtered = passed(k.poles, state.perturbation_um, found_um)
    error_mN = 0.0
    if kappa > 0.0:
        error_mN = force_mN - force_r_mN - state.lead_um / k.compliance_um_per_mN
    errors = passed(k.poles, state.force_error_mN, error_mN)
    slow_mN = state.slow_error_mN + k.force_share * (errors.four - state.slow_error_mN)
    x_d_um = desired_position(
        k.impedance,
        deviation_1_um=state.deviation_1_um,
        deviation_2_um=state.deviation_2_um,
        force_mN=slow_mN,
        force_r_mN=0.0,
        x_r_um=x_r_um,
    )
    speed, acceleration = plan.speed_um_per_s, plan.acceleration_um_per_s2
    later_um = x_d_um + k.ahead_s * (speed + 0.5 * k.ahead_s * acceleration)
    lead_um = (k.lead_s + stiffer * k.lag_s) * (speed + k.ahead_s * acceleration)
    lead_um += k.lead_s2 * acceleration
    wanted_um = stiffer * later_um - touch_um + lead_um - filtered.four
    if state.rebased > 0.5 and not fresh:
        jump_um = wanted_um - k.um_per_V * applied_V - k.period_s * speed
        wanted_um -= jump_um
        filtered = moved(filtered, jump_um)
        begun_um, before_um = begun_um + jump_um, before_um + jump_um
    coasting_um = (k.um_per_V * applied_V + filtered.four + touch_um) / stiffer
    missed_um = found_um - before_um
    after = FpbsmicState(
        history=History(x_um, state.history.x_2_um, force_mN, applied_V, coasting_um),
        fresh=0.0,
        rebased=0.0,
        x_d_um=x_d_um,
        deviation_1_um=x_d_um - x_r_um,
        deviation_2_um=state.deviation_1_um,
        lead_um=k.lead_s * speed + k.lead_s2 * acceleration,
        lagging_um=free_um,
        begun_um=begun_um,
        perturbation_um=filtered,
        force_error_mN=errors,
        slow_error_mN=slow_mN,
    )
    return after, LawOutput(
        voltage_V=wanted_um / k.um_per_V,
        x_d_um=x_d_um,
        error_um=x_um - state.x_d_um,
        integral_um=0.0,
        sliding_um=(found_um - begun_um) / stiffer,
        band_um=0.5 * abs(missed_um) / stiffer,
        residual_um=missed_um / stiffer,
        perturbation_mN=found_um / k.compliance_um_per_mN,
        perturbation_error_mN=-missed_um / k.compliance_um_per_mN,
    )


def remedies(gains: Mapping[str, float]) -> Sequence[tuple[str, Sequence[float]]]:
    """Return gains that may make a loop stable, the smallest change first."""
    poles = gains["n"]
    return (
        ("f_w", [gains["f_w"] * factor for factor in (0.7, 0.5, 0.25, 0.1)]),
        ("n", [poles + more for more in (1.0, -1.0) if 1.0 <= poles + more <= MOST_POLES]),
        ("K_f", [gains["K_f"] * factor for factor in (0.5, 0.1) if gains["K_f"] > 0.0]),
    )


LAW = LawDefinition(
    name="fpbsmic",
    title="FPBSMIC",
    summary="PBSMIC with a filtered perturbation: for periods of 0.25 to 2.5 ms, at which it can "
    "follow paths of 10 to 20 Hz",
    parameters=(
        LawParameter("n", "", "poles of the perturbation's filter, 1 to 4", 3.0, True),
        LawParameter("f_w", "Hz", "corner frequency of each of these poles", 60.0, True),
        LawParameter("f_F", "Hz", "corner frequency of the low-pass of the force error", 3.0, True),
        *IMPEDANCE_GAINS,
    ),
    build=build,
    start=start,
    step=step,
    impedance=impedance_of,
    remedies=remedies,
    previews=True,
    rebase=rebase,
)
