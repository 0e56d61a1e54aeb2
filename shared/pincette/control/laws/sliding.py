"""Parts that both sliding mode laws share: gains, boundary layer, band, integral, voltage.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.history import Outlook
from pincette.control.laws.impedance import (
    IMPEDANCE_GAINS,
    DiscreteImpedance,
    discrete_impedance_of,
)
from pincette.control.laws.parameters import LawParameter
from pincette.control.record import FrozenRecord

SEARCH = (
    ("K_P", (0.1, 0.2, 0.35, 0.5, 1.0, 2.0)),
    ("K_f", (0.0, 1000.0, 2000.0, 3500.0, 5000.0, 7500.0, 10000.0, 15000.0)),
)
"""Grid of a search for gains. K_I stays 1: without the switching term only K_I/(K_P + K_I)
matters."""
SWITCHING = "K_S"


@dataclass(frozen=True, slots=True)
class SlidingParameters:
    """Model of the arm, target impedance and gains of a law (in DSMIFC K̃_P, K̃_I, K̃_S, δ̃)."""

    plant: DifferenceEquation
    impedance: DiscreteImpedance
    K_P: float
    K_I: float
    """K_P and K_I without unit; K_P ≥ 0, K_I > 0. If the model is exact, each sample reduces the
    error e, in DSMIFC the impedance measure error, by the fraction K_I/(K_P + K_I)."""
    K_S: float
    """Switching gain in mN; 0 switches the term off. The slope (K_P + K_I)·K_S/(k̄·δ) inside the
    boundary layer, in DSMIFC times K̄, should lie between 0 and 1."""
    delta: float
    """Half width δ of the boundary layer, in the unit of the sliding function: µm or mN."""


def build(
    plant: DifferenceEquation, gains: Mapping[str, float], period_s: float
) -> SlidingParameters:
    """Discretise the impedance, and use the gains unchanged; raises ValueError."""
    return SlidingParameters(
        plant=plant,
        impedance=discrete_impedance_of(gains, period_s),
        K_P=gains["K_P"],
        K_I=gains["K_I"],
        K_S=gains["K_S"],
        delta=gains["delta"],
    )


def sliding_parameters(
    delta_unit: str, *, delta: float, K_P: float, K_S: float
) -> tuple[LawParameter, ...]:
    """Return the definitions of the gains of a sliding mode law.

    Parameters
    ----------
    delta_unit, delta
        Unit of the sliding function, and half width of its boundary layer.
    K_P, K_S
        Values of the paper, section VI.D. By default K_P is 1 and the switching term is off, since
        no printed K_S is applicable to the consistent set.
    """
    return (
        LawParameter("K_P", "", "proportional gain of the sliding function", 1.0, False, K_P),
        LawParameter("K_I", "", "integral gain of the sliding function", 1.0, True),
        LawParameter("K_S", "mN", "gain of the switching term; 0 switches it off", 0.0, False, K_S),
        LawParameter("delta", delta_unit, "half width of the boundary layer", delta, True),
        *IMPEDANCE_GAINS,
    )


def remedies(gains: Mapping[str, float]) -> Sequence[tuple[str, Sequence[float]]]:
    """Return gains that may make a loop stable, the smallest change first."""
    K_P, K_f = gains["K_P"] or gains["K_I"], gains["K_f"]
    return (
        ("K_P", [K_P * factor for factor in (2.0, 0.5, 5.0, 0.2)]),
        ("K_f", [K_f * factor for factor in (0.5, 0.1) if K_f > 0.0]),
    )


class LawOutput(FrozenRecord, frozen=True):
    """The voltage for tick k, and intermediate results of the law.

    Lengths are as in PBSMIC. DSMIFC, whose sliding function is a force, divides it by K̄. For a law
    without a sliding function the corresponding fields are 0.
    """

    voltage_V: float
    """Voltage u_k before limiting, in V."""
    x_d_um: float
    """Position that the impedance requests at k, in µm: (16), in DSMIFC with x instead of x_d."""
    error_um: float
    """Error e_{k-1} = x_{k-1} - x_{d,k-1}, in µm; DSMIFC: ε_{k-1}/K̄ (33)."""
    integral_um: float
    """Integral ε_{k-1} (19), in µm; DSMIFC: ζ_{k-1}/K̄ (35)."""
    sliding_um: float
    """Sliding function s_{k-1} (18), in µm; DSMIFC: s_{k-1}/K̄ (34)."""
    band_um: float
    """Half width of the band outside which |s| cannot have grown, in µm; see ``sliding_band``."""
    residual_um: float
    """Measured x_{k-1} minus the prediction of (17) for the voltage applied, in µm."""
    perturbation_mN: float
    """Perturbation p̂_k = p_{k-1} (6), computed with the F that the law uses, in mN."""
    perturbation_error_mN: float
    """Perturbation error p̃_{k-1} = p_{k-2} - p_{k-1} (8), computed with the F that the law uses,
    in mN: -k̄ times the residual."""


def saturation(s: float, delta: float) -> float:
    """Return the saturation function that replaces sgn(s) in (25) and (42).

        sat(s) = sgn(s) where |s| > δ,  s/δ where |s| ≤ δ                                (32)

    ``s`` and ``delta`` are in the unit of the sliding function; δ > 0. The result is in [-1, 1].
    """
    if s > delta:
        return 1.0
    if s < -delta:
        return -1.0
    return s / delta


def sliding_band(per_mN: float, K_S_mN: float, perturbation_error_mN: float) -> float:
    """Return the half width of the band outside which a step of the law does not increase |s|.

    With a the factor of p̃ in (28) or (45), s_k = s_{k-1} - a(K_S sgn(s_{k-1}) + p̃_k), so that

        |s_k| ≤ |s_{k-1}|  where  |s_{k-1}| ≥ a (K_S + |p̃_k|)/2  and  K_S ≥ |p̃_k|

    (31) and (48) of the paper omit the band. ``per_mN`` is a; the result has the unit of s.
    """
    return 0.5 * per_mN * (K_S_mN + abs(perturbation_error_mN))


def winds_up(limited: int, error: float) -> bool:
    """Return whether an integral of ``error`` would push the voltage further against a limit.

    ``limited`` is +1 if the voltage may not rise, -1 if it may not fall, else 0. A position below
    its target, a negative error, requires more voltage.
    """
    return limited * error < 0.0


def sliding_output(
    parameters: SlidingParameters,
    seen: Outlook,
    *,
    applied_V: float,
    x_d_um: float,
    error: float,
    integral: float,
    limited: int,
    per_um: float,
) -> tuple[float, LawOutput]:
    """Return the sum of errors up to k-1, and u_k of (25) or (42) with sat (32) instead of sgn.

        u_k = u_{k-1} + (k̄/d̄)[x_d + K_P·error/(c·(K_P + K_I)) - x̂_k] - (K_S/d̄) sat(s_{k-1}/δ)
        s_{k-1} = K_P·error + K_I·Σ error

    Parameters
    ----------
    x_d_um
        Position that the impedance requests at k.
    error, integral
        e_{k-1} or ε_{k-1}, and their sum up to k-2; an error that ``winds_up`` is not added.
    per_um
        c: number of units of the error that 1 µm corresponds to; 1 in PBSMIC, K̄ in DSMIFC.
    """
    plant, K_P, K_I = parameters.plant, parameters.K_P, parameters.K_I
    if not winds_up(limited, error):
        integral += error
    sliding = K_P * error + K_I * integral
    reaching_um = K_P * error / (per_um * (K_P + K_I))
    voltage_V = (
        applied_V
        + plant.k_bar / plant.d_bar * (x_d_um + reaching_um - seen.coasting_um)
        - parameters.K_S / plant.d_bar * saturation(sliding, parameters.delta)
    )
    per_mN = (K_P + K_I) / plant.k_bar
    return integral, LawOutput(
        voltage_V=voltage_V,
        x_d_um=x_d_um,
        error_um=error / per_um,
        integral_um=integral / per_um,
        sliding_um=sliding / per_um,
        band_um=sliding_band(per_mN, parameters.K_S, seen.perturbation_error_mN),
        residual_um=seen.residual_um,
        perturbation_mN=seen.perturbation_mN,
        perturbation_error_mN=seen.perturbation_error_mN,
    )
