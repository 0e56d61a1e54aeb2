"""A law as it runs: scheme, parameter set, gains, and which force serves as F_k.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass, replace
from typing import Literal

from pincette.control.arm.plant import ArmParameters, discretize, printed_arm
from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.estimation import smoothing
from pincette.control.laws import dsmifc, pbsmic
from pincette.control.laws.dsmifc import DsmifcParameters, DsmifcState
from pincette.control.laws.history import History, rest
from pincette.control.laws.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.laws.pbsmic import PbsmicParameters, PbsmicState
from pincette.control.laws.sliding import LawOutput

Scheme = Literal["pbsmic", "dsmifc"]
ParameterSet = Literal["consistent", "printed"]
ForceAge = Literal["planned", "newest"]


@dataclass(frozen=True, slots=True)
class LawSettings:
    """What a law is made of, in µm, mN and s.

    Raises
    ------
    ValueError
        Where a gain is negative, or zero where it must not be.
    """

    scheme: Scheme = "pbsmic"
    set: ParameterSet = "consistent"
    """Whose m, b, k, d the law works with: the rig's, or those that the paper prints."""
    K_P: float = 1.0
    K_I: float = 1.0
    K_S: float = 0.0
    """mN."""
    delta: float = 100.0
    """µm for PBSMIC, mN for DSMIFC."""
    M: float = 1e-3
    B: float = 8.9221
    K: float = 1.9901e4
    K_f: float = 5000.0
    force_age: ForceAge = "planned"
    """F_k: the newest estimate as it is, or carried on to k by the change of F_r."""

    def __post_init__(self) -> None:
        require_not_negative("K_P", self.K_P, "")
        require_positive("K_I", self.K_I, "")
        require_not_negative("K_S", self.K_S, "mN")
        require_positive("delta", self.delta, "µm" if self.scheme == "pbsmic" else "mN")
        require_not_negative("M", self.M, "mN·s²/µm")
        require_not_negative("B", self.B, "mN·s/µm")
        require_positive("K", self.K, "mN/µm")
        require_not_negative("K_f", self.K_f, "mN/mN")


@dataclass(frozen=True, slots=True)
class Law:
    """A law at one sampling period."""

    parameters: PbsmicParameters | DsmifcParameters
    force_share: float | None
    """Share by which F - F_r follows each estimate; None: the newest estimate as it is."""


@dataclass(frozen=True, slots=True)
class LawState:
    """What a law remembers between ticks."""

    law: PbsmicState | DsmifcState
    x_d_um: float
    """x_{d,k-1}."""
    force_r_mN: float
    """F_{r,k-1}."""
    force_error_mN: float
    """F - F_r, low-passed."""


def default_settings(scheme: Scheme, parameter_set: ParameterSet) -> LawSettings:
    """Gains of a scheme where nothing else is known.

    ``printed`` gives those of the paper's section VI.D, with which its figures were made;
    ``consistent`` switches the switching term off, since no printed K_S carries over.
    """
    if parameter_set == "consistent":
        delta = 100.0 if scheme == "pbsmic" else 1e6
        return LawSettings(scheme=scheme, delta=delta)
    if scheme == "pbsmic":
        return LawSettings(
            scheme, parameter_set, K_P=1.0, K_S=0.003, delta=100.0, force_age="newest"
        )
    return LawSettings(scheme, parameter_set, K_P=2.0, K_S=1e3, delta=1e6, force_age="newest")


def build(settings: LawSettings, arm: ArmParameters, period_s: float, force_filter_s: float) -> Law:
    """Make a law of its settings.

    Parameters
    ----------
    arm
        The rig's m, b, k, d; the printed set puts its own in their place.
    force_filter_s
        Time constant of the low-pass over F - F_r; 0 has none.

    Raises
    ------
    ValueError
        Where the period is not positive, or M/T² or B/T is beyond what a number holds.
    """
    plant = discretize(printed_arm() if settings.set == "printed" else arm, period_s)
    impedance = discretize_impedance(
        ImpedanceParameters(M=settings.M, B=settings.B, K=settings.K, K_f=settings.K_f), period_s
    )
    require_positive("impedance K̄", impedance.K_bar, "mN/µm")
    kind = PbsmicParameters if settings.scheme == "pbsmic" else DsmifcParameters
    return Law(
        kind(plant, impedance, settings.K_P, settings.K_I, settings.K_S, settings.delta),
        smoothing(period_s, force_filter_s) if settings.force_age == "planned" else None,
    )


def start(law: Law, *, x_um: float, x_r_um: float, force_mN: float, applied_V: float) -> LawState:
    """State of a resting arm, for which F_r = F."""
    history = rest(x_um=x_um, force_mN=force_mN, applied_V=applied_V)
    return _start(law, history, x_um, x_r_um, force_mN, force_mN)


def rebase(
    law: Law,
    state: LawState,
    *,
    x_um: float,
    x_r_um: float,
    force_mN: float,
    force_r_mN: float,
) -> LawState:
    """Begin another segment, or another law, without a bump, before the step with ``x_um``.

    What was measured and applied stays; F_k - F_{k-1} counts from ``force_mN``, so that a force
    which the law was not fed before does not act as a step. The step that follows keeps the
    voltage of a resting arm where x_{r,k} = x and F_k = F_{r,k}.

    ``x_r_um`` and ``force_r_mN`` are x_{r,k-1} and F_{r,k-1}, those of the sample ``x_um``, where
    references go on; then a change of law in motion is not seen in the voltage where the model
    holds. Where they begin anew there are none of k-1, and those of k take their place.
    """
    history = replace(state.law.history, force_mN=force_mN)
    return _start(law, history, x_um, x_r_um, force_mN, force_r_mN)


def _start(
    law: Law,
    history: History,
    x_um: float,
    x_r_um: float,
    force_mN: float,
    force_r_mN: float,
) -> LawState:
    if isinstance(law.parameters, PbsmicParameters):
        inner = pbsmic.start(history, x_um=x_um, x_r_um=x_r_um)
    else:
        inner = dsmifc.start(
            history, x_um=x_um, x_r_um=x_r_um, force_mN=force_mN, force_r_mN=force_r_mN
        )
    return LawState(inner, x_um, force_r_mN, force_mN - force_r_mN)


def step(
    law: Law,
    state: LawState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
) -> tuple[LawState, LawOutput]:
    """Compute u_k by (25) or (42).

    The estimate F̂ belongs to the newest sample, that is to k-1, while x_{r,k} and F_{r,k} hold for
    k. Fed as it is (``newest``), it makes the law see a moving F_r as an error of one period.
    Otherwise F_k is what the plan makes of it,

        F_k = F_{r,k} + δ_k,  δ_k = δ_{k-1} + share·(F̂ - F_{r,k-1} - δ_{k-1})

    so that the low-pass takes the noise off the error and does not lag the force itself.
    """
    error_mN = force_mN - state.force_r_mN
    if law.force_share is not None:
        error_mN = state.force_error_mN + law.force_share * (error_mN - state.force_error_mN)
        force_mN = force_r_mN + error_mN
    inner, parameters = state.law, law.parameters
    if isinstance(parameters, PbsmicParameters) and isinstance(inner, PbsmicState):
        after, output = pbsmic.step(
            parameters,
            inner,
            x_um=x_um,
            force_mN=force_mN,
            applied_V=applied_V,
            x_r_um=x_r_um,
            force_r_mN=force_r_mN,
            limited=limited,
        )
    elif isinstance(parameters, DsmifcParameters) and isinstance(inner, DsmifcState):
        after, output = dsmifc.step(
            parameters,
            inner,
            x_um=x_um,
            force_mN=force_mN,
            applied_V=applied_V,
            x_r_um=x_r_um,
            force_r_mN=force_r_mN,
            limited=limited,
        )
    else:
        raise TypeError("the state belongs to another law: rebase it first")
    return LawState(after, output.x_d_um, force_r_mN, error_mN), output
