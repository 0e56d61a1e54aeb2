"""Law of two driven arms that hold one part. It controls position and force separately.

The coordinate of each arm is positive towards the part. With the displacements X_i that the arms
would have if they were free, the motion decouples into the position q of the part's middle and the
force F:

    q = (x_1 - x_2)/2,   x_i = X_i - s_i·F,   x_1 + x_2 = g + c·F                       (1), (53)
    a = (X_1 - X_2)/2 = q + (s_1 - s_2)/2·F,   b = X_1 + X_2 = g + S·F,   S = s_1 + s_2 + c

c is the compliance of part and faces together. The model errors of q and F are filtered separately;
δT is the time from a sample to the output of its voltages, and φ = max(0, δ - 1/2):

    x̄_i,k = (1-φ)·H_i,k + φ·H_i,k-1            of the age of x_i,k
    l_i   = 2ζ_i/ω_i·q̇_r + q̈_r/ω_i²           by which X_i leads q along the plan
    F̂_k   = [F̂_1 + F̂_2 - l_1/s_1 + l_2/s_2]/2   a swing of the held part cancels in the mean
    W_q,k = q_k - ā_k + (s_1 - s_2)/2·F_r,k-1,  Ŵ_q = F_q(z) W_q
    W_b,k = S·F̂_k - b̄_k  pressed,  x_1 + x_2 - b̄_k  free,     Ŵ_b = F_b(z) W_b
    a_k   = q_r + (s_1 - s_2)/2·F_r + (l_1 + l_2)/2 - Ŵ_q
    b_k   = S·F_r + l_1 - l_2 - Ŵ_b  pressed,   d_r - Ŵ_b  free
    X_1   = b_k/2 + a_k,   X_2 = b_k/2 - a_k,   u_i = H_i⁻¹[X_i]

at t = (k + δ + 1/2)T, later by T·κ/(1 - κ) if an output lags, with F(z) as in ``fpbsmic``; d_r is
the reference of x_1 + x_2 for free arms. Ŵ is constant while arms search for the part, so that the
law does not compensate the force of the contact and only the compliance of the arms acts. W
contains g and the offset between x_i and H_i. With n = 1 and p = K_P/(K_P + K_I) each of the two
loops has the reaching law of PBSMIC. The loops are independent: no contact line couples position
and force, and no gain trades one for the other.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013, which names two arms as future work.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, pi

from pincette.control.arm.plant import PROMPT, ArmParameters, OutputTiming
from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.observers import SHORTEST_PERIODS, held_age, kept
from pincette.control.laws.fpbsmic import LATEST, MOST_POLES, Cascade, passed
from pincette.control.laws.parameters import LawParameter
from pincette.control.record import FrozenRecord

Pair = tuple[float, float]
"""Values of the first and of the second arm."""

PARAMETERS = (
    LawParameter("n", "", "poles of both filters, 1 to 4", 3.0, True),
    LawParameter("f_q", "Hz", "corner frequency of each pole of the place's filter", 60.0, True),
    LawParameter("f_F", "Hz", "corner frequency of each pole of the force's filter", 10.0, True),
)
"""Gains, with defaults for periods that are short compared with that of the mode; see
``default_gains``."""
LONG = {"n": 1.0, "f_q": 5.5, "f_F": 3.0}
"""Defaults for long periods. With a period of 20 ms each sample corrects the fraction 0.5 of the
position error, and 0.31 of the force error."""


@dataclass(frozen=True, slots=True)
class TwoArmParameters:
    """Parameters of both arms, the part and the filters."""

    compliances_um_per_mN: Pair
    """Compliances s_i of the arms, in µm/mN."""
    leads_s: Pair
    """Coefficients 2ζ_i/ω_i of the leads, in s."""
    leads_s2: Pair
    """Coefficients 1/ω_i² of the leads, in s²."""
    joint_um_per_mN: float
    """Compliance S of the two arms and the part together, in µm/mN."""
    older: float
    """Weight φ of the previous free displacement."""
    ahead_s: float
    """Time φT from the next sample to the instant for which the voltages are chosen, in s."""
    lag_kept: float
    """Factor κ = e^(-T/τ) of a lag between output and arm over one period; 0 without a lag."""
    lag_ahead_s: float
    """Time T·κ/(1 - κ) by which x̄ lags behind a motion at constant speed, in s."""
    place_poles: Cascade
    force_poles: Cascade


class TwoArmReferences(FrozenRecord, frozen=True):
    """References of part and arms at the next sample, with their derivatives."""

    place_um: float
    """Reference q_r of the part's position, in µm."""
    force_mN: float = 0.0
    """Reference F_r of the force on a part that both arms press, in mN."""
    opening_um: float = 0.0
    """Reference d_r of x_1 + x_2 for arms that do not press, in µm."""
    pressed: bool = True
    place_speed_um_per_s: float = 0.0
    place_acceleration_um_per_s2: float = 0.0
    force_rate_mN_per_s: float = 0.0
    opening_speed_um_per_s: float = 0.0
    seeks: bool = False
    """True while free arms search for the part. A position error is then attributed to a force and
    not corrected."""


class TwoArmState(FrozenRecord, frozen=True):
    """State of the law before the tick that computes both voltages."""

    fresh: bool
    """True before the first step, in which the perturbation is not filtered."""
    pressed: bool
    older_um: Pair
    """Free displacements H_i of the previous sample, in µm."""
    lagging_um: Pair
    """Lagged free displacements x̄_i of the previous sample, in µm."""
    leads_um: Pair
    """Leads l_i of the newest sample, in µm."""
    force_r_mN: float
    """Reference F_r of the newest sample, in mN; 0 for arms that do not press."""
    place_um: Cascade
    """Stages of the filter F_q, in µm; the last one is Ŵ_q."""
    sum_um: Cascade
    """Stages of the filter F_b, in µm; the last one is Ŵ_b."""


class TwoArmOutput(FrozenRecord, frozen=True):
    """Free displacements that the law requests, and the errors relative to its last target."""

    free_um: Pair
    """Free displacements X_i one period ahead, in µm: u_i = H_i⁻¹[X_i]."""
    place_um: float
    """Position q of the part at the newest sample, in µm."""
    force_mN: float
    """Force F̂ of the newest sample, in mN, without the contribution of the planned acceleration
    and speed."""
    disagreement_mN: float
    """Difference F̂_1 - F̂_2, in mN; 0 if nothing else touches the part."""
    place_missed_um: float
    """Error W_q - Ŵ_q before this sample, in µm."""
    sum_missed_um: float
    """Error W_b - Ŵ_b before this sample, in µm."""


def default_gains(omega_n_rad_per_s: float, period_s: float) -> dict[str, float]:
    """Return the default gains, which depend on the ratio of the period to that of the mode."""
    if period_s < SHORTEST_PERIODS * 2.0 * pi / omega_n_rad_per_s:
        return {each.name: each.value("consistent") for each in PARAMETERS}
    return dict(LONG)


def build(
    arms: tuple[ArmParameters, ArmParameters],
    gains: Mapping[str, float],
    period_s: float,
    part_um_per_mN: float = 0.0,
    output: OutputTiming = PROMPT,
) -> TwoArmParameters:
    """Build the filters of the law.

    Parameters
    ----------
    arms
        m, b, k of each arm as identified.
    part_um_per_mN
        Compliance c of part and faces together, which is small compared with that of the arms.

    Raises
    ------
    ValueError
        If a number or the order is impossible, or the delay is too long.
    """
    T = require_positive("period", period_s, "s")
    c = require_not_negative("compliance of the part", part_um_per_mN, "µm/mN")
    for parameter in PARAMETERS:
        parameter.check(gains[parameter.name])
    poles = gains["n"]
    if poles not in range(1, MOST_POLES + 1):
        raise ValueError(f"n = {poles:g}, must be a whole number of poles from 1 to {MOST_POLES}")
    delay = output.delay_s / T
    if delay > LATEST:
        raise ValueError(
            f"a delay of {1000.0 * output.delay_s:.3g} ms from sample to voltage is above "
            f"{LATEST:g} periods of {1000.0 * T:.3g} ms: choose a longer period"
        )

    def cascade(name: str) -> Cascade:
        p = exp(-2.0 * pi * gains[name] * T)
        return Cascade(*(p if stage < poles else 0.0 for stage in range(MOST_POLES)))

    first, second = arms
    older, lag_kept = held_age(delay), kept(T, output.lag_s)
    return TwoArmParameters(
        compliances_um_per_mN=(1.0 / first.k, 1.0 / second.k),
        leads_s=(first.b / first.k, second.b / second.k),
        leads_s2=(first.m / first.k, second.m / second.k),
        joint_um_per_mN=1.0 / first.k + 1.0 / second.k + c,
        older=older,
        ahead_s=older * T,
        lag_kept=lag_kept,
        lag_ahead_s=T * lag_kept / (1.0 - lag_kept),
        place_poles=cascade("f_q"),
        force_poles=cascade("f_F"),
    )


def start() -> TwoArmState:
    """Return the state for a bumpless start: the next step keeps the voltages if errors are 0."""
    nothing = Cascade(0.0, 0.0, 0.0, 0.0)
    return TwoArmState(
        fresh=True,
        pressed=False,
        older_um=(0.0, 0.0),
        lagging_um=(0.0, 0.0),
        leads_um=(0.0, 0.0),
        force_r_mN=0.0,
        place_um=nothing,
        sum_um=nothing,
    )


def step(
    parameters: TwoArmParameters,
    state: TwoArmState,
    *,
    tips_um: Pair,
    free_um: Pair,
    forces_mN: Pair,
    references: TwoArmReferences,
) -> tuple[TwoArmState, TwoArmOutput]:
    """Compute the free displacements X_1 and X_2 of tick k.

    Parameters
    ----------
    tips_um
        x_i,k, positive towards the part.
    free_um
        H_i,k: free response of each arm at the sample, after u_i of k-1.
    forces_mN
        F̂_i,k from the estimator of each arm, not filtered.
    references
        References of the next sample. When ``pressed`` changes, the loop of the sum starts
        bumplessly: at F_r = F̂ after a contact, at d_r = x_1 + x_2 after a loss of contact.
    """
    k, r = parameters, references
    s_1, s_2 = k.compliances_um_per_mN
    bar_um = aged(k, state, free_um)
    a_um, b_um = 0.5 * (bar_um[0] - bar_um[1]), bar_um[0] + bar_um[1]
    force_1 = forces_mN[0] - state.leads_um[0] / s_1
    force_2 = forces_mN[1] + state.leads_um[1] / s_2
    force_mN = 0.5 * (force_1 + force_2)
    place_um = 0.5 * (tips_um[0] - tips_um[1])
    uneven = 0.5 * (s_1 - s_2)
    taken_mN = r.force_mN if r.pressed else 0.0
    place_missed = place_um - a_um + uneven * (taken_mN if state.fresh else state.force_r_mN)
    sum_missed = (k.joint_um_per_mN * force_mN if r.pressed else tips_um[0] + tips_um[1]) - b_um
    place_before, sum_before = state.place_um.four, state.sum_um.four
    if state.fresh:
        place_before, sum_before = place_missed, sum_missed
        place = Cascade(place_missed, place_missed, place_missed, place_missed)
    else:
        place = state.place_um if r.seeks else passed(k.place_poles, state.place_um, place_missed)
    if state.fresh or state.pressed != r.pressed:
        sum_before = sum_missed
        total = Cascade(sum_missed, sum_missed, sum_missed, sum_missed)
    else:
        total = state.sum_um if r.seeks else passed(k.force_poles, state.sum_um, sum_missed)
    speed, acceleration = r.place_speed_um_per_s, r.place_acceleration_um_per_s2
    later_um = r.place_um + k.ahead_s * (speed + 0.5 * k.ahead_s * acceleration)
    later_speed = speed + k.ahead_s * acceleration
    lead_1, lead_2 = _leads(k, later_speed, acceleration)
    later_um += k.lag_ahead_s * later_speed
    wanted_a = later_um + uneven * taken_mN + 0.5 * (lead_1 + lead_2) - place.four
    ahead_s = k.ahead_s + k.lag_ahead_s
    if r.pressed:
        later_mN = r.force_mN + ahead_s * r.force_rate_mN_per_s
        wanted_b = k.joint_um_per_mN * later_mN + lead_1 - lead_2 - total.four
    else:
        wanted_b = r.opening_um + ahead_s * r.opening_speed_um_per_s + lead_1 - lead_2 - total.four
    leads_um = _leads(k, speed, acceleration)
    after = TwoArmState(False, r.pressed, free_um, bar_um, leads_um, taken_mN, place, total)
    return after, TwoArmOutput(
        free_um=(0.5 * wanted_b + wanted_a, 0.5 * wanted_b - wanted_a),
        place_um=place_um,
        force_mN=force_mN,
        disagreement_mN=force_1 - force_2,
        place_missed_um=place_missed - place_before,
        sum_missed_um=sum_missed - sum_before,
    )


def aged(k: TwoArmParameters, state: TwoArmState, free_um: Pair) -> Pair:
    """Return the free displacements x̄_i with the age of the sample."""
    if state.fresh:
        return free_um
    older = k.older
    one, two = (
        (1.0 - k.lag_kept) * ((1.0 - older) * now + older * before) + k.lag_kept * lagging
        for now, before, lagging in zip(free_um, state.older_um, state.lagging_um, strict=True)
    )
    return one, two


def _leads(k: TwoArmParameters, speed: float, acceleration: float) -> Pair:
    """Return the leads l_1 and l_2 for a motion of the part's position."""
    one, two = (
        of_speed * speed + of_acceleration * acceleration
        for of_speed, of_acceleration in zip(k.leads_s, k.leads_s2, strict=True)
    )
    return one, two
