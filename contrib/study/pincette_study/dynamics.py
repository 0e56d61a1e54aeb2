"""Fig. 5, and the limits of the printed laws: frequency response and stability map."""

from math import pi

import numpy as np
from numpy.typing import NDArray

from pincette.config import RigFile, Simulation, derived, gains
from pincette.control.calibration.frequency_response import FrequencyResponse, swept_response
from pincette.control.calibration.lines import compliance
from pincette.control.calibration.resonance import SecondOrder, fit_second_order
from pincette.control.force.observers import ForceObserver
from pincette.control.laws.dsmifc import LAW as DSMIFC
from pincette.control.laws.pbsmic import LAW as PBSMIC
from pincette.control.stability.assessment import radius_map
from pincette.control.stability.limits import LIMIT_RADIUS
from pincette.plotting import BLUE, INK, ORANGE, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.open_loop import drive
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import simulation_of

RATE_HZ = 4000.0
FROM_HZ, TO_HZ = 5.0, 500.0
SWEEP_S = 8.0
SWEEP_V = 0.1
PERIODS_S = tuple(1e-3 * ms for ms in (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30))
GAINS = (0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
SHORT_S = 0.0055
"""Period in s below which the quasi-static observer attributes the ringing of the mode to a
force."""
SOFT_MN_PER_UM = 1e-5
"""Stiffness of a spring so soft that the arm's motion does not change its force, as for a
weight."""


def fig_5(rig: RigFile) -> Section:
    """Run Fig. 5: swept sine on the free arm, its second-order model, and the compliance."""
    response = _sweep(simulation_of(rig))
    model = fit_second_order(
        response.frequency_hz,
        response.gain_um_per_V,
        to_hz=TO_HZ,
        log_gain_uncertainty=response.log_gain_uncertainty,
    )
    omega_n, zeta = model.natural_frequency_rad_per_s, model.damping_ratio
    sag_um = _sag_um(simulation_of(rig))
    s_p = compliance([0.0, printed.WEIGHT_MN], [0.0, sag_um]).compliance_um_per_mN
    return Section(
        key="fig5",
        title="Fig. 5 and (55): the mode and the compliance",
        text=(
            f"Swept sine of {SWEEP_V:g} V amplitude from {FROM_HZ:g} to {TO_HZ:g} Hz, sampled at "
            f"{RATE_HZ:g} Hz. At so small a drive the hysteresis gives less than the 19.0 µm/V at "
            "2 V peak to peak on which the rig is set.",
        ),
        pictures=(Picture("fig5", "Fig. 5 repeated", _bode(response, model)),),
        comparisons=(
            Comparison("ω_n²", "1/s²", printed.NATURAL_FREQUENCY_SQUARED, omega_n**2),
            Comparison("2ζω_n", "1/s", printed.DAMPING_PER_S, 2.0 * zeta * omega_n),
            Comparison(
                "gain at low frequency", "µm/V", printed.PIEZO_UM_PER_V, model.gain_um_per_V
            ),
            Comparison("s_p, by a known weight", "µm/mN", printed.SAG_UM / printed.WEIGHT_MN, s_p),
        ),
    )


def stability(rig: RigFile) -> Section:
    """Return the section on stability: the spectral radius of the real loop over period and
    gain.
    """
    settings = PBSMIC.settings()
    maps = {
        law.title: radius_map(
            gains.loop(rig, law.settings()),
            gains.intervals(rig),
            periods_s=PERIODS_S,
            gains=GAINS,
            observer_at=lambda period_s: _observer(rig, period_s),
        )
        for law in (PBSMIC, DSMIFC)
    }
    at_paper = list(PERIODS_S).index(printed.PERIOD_S)
    return Section(
        key="stability",
        title="How fast the loop may be sampled",
        text=(
            "Worst spectral radius over ω_n ± 5 %, the part's stiffness within its "
            "tolerance, the free arm, and a delay of up to half a period; the law, its "
            "impedance filter and its force observer as they run (below two periods of the "
            f"mode the Kalman filter that knows it). Beyond {LIMIT_RADIUS:g} a job is "
            "refused before anything moves. Backward differences do not see the mode of 388 "
            "Hz: sampling faster needs more than another parameter. K_f = "
            f"{settings.gains['K_f']:g}, no switching.",
        ),
        pictures=(Picture("stability", "worst spectral radius", _map_picture(maps)),),
        comparisons=tuple(
            Comparison(
                f"{name} at 20 ms, K_P = {gain:g}",
                "",
                None,
                float(radii[at_paper][GAINS.index(gain)]),
            )
            for name, radii in maps.items()
            for gain in (5.0, 1.0, 0.5)
        ),
        data={
            "periods_s": list(PERIODS_S),
            "K_P": list(GAINS),
            "radius": {name: radii.tolist() for name, radii in maps.items()},
        },
    )


def _observer(rig: RigFile, period_s: float) -> ForceObserver:
    name = "kalman" if period_s < SHORT_S else "quasi_static"
    model = rig.model.model_copy(update={"force_observer": name})
    at_period = rig.rig.model_copy(update={"period_s": period_s})
    return derived.force_observer(rig.model_copy(update={"rig": at_period, "model": model}))


def _sweep(simulation: Simulation) -> FrequencyResponse:
    """Return the frequency response to a chirp that begins and ends at rest, output without delay
    or lag.
    """
    bare = simulation.model_copy(
        update={
            "bead": False,
            "output_lag_s": 0.0,
            "actuation_delay_s": 0.0,
            "substep_s": 1.0 / RATE_HZ,
        }
    )
    count = round(SWEEP_S * RATE_HZ)
    t = np.arange(count) / RATE_HZ
    rate = (TO_HZ - FROM_HZ) / SWEEP_S
    edge = np.minimum(1.0, np.minimum(t, SWEEP_S - t) / (0.02 * SWEEP_S))
    chirp = SWEEP_V * edge * np.sin(2.0 * pi * (FROM_HZ * t + 0.5 * rate * t * t))
    rest = [0.0] * round(0.3 * RATE_HZ)
    motion = drive(bare, [*chirp.tolist(), *rest], 1.0 / RATE_HZ)
    return swept_response(
        motion.voltage_V.tolist(), motion.x_um.tolist(), RATE_HZ, from_hz=FROM_HZ, to_hz=TO_HZ
    )


def _sag_um(simulation: Simulation) -> float:
    """Return the displacement under a known weight in µm, as the sensor measures it."""
    weighted = simulation.model_copy(
        update={
            "environment_stiffness_mN_per_um": SOFT_MN_PER_UM,
            "bead_contact_um": -printed.WEIGHT_MN / SOFT_MN_PER_UM,
        }
    )
    motion = drive(weighted, [0.0] * 200, printed.PERIOD_S)
    return -float(np.mean(motion.x_um[100:]))


def _bode(response: FrequencyResponse, model: SecondOrder) -> bytes:
    frequency = response.frequency_hz
    omega = 2.0 * pi * frequency
    fitted = model.gain_um_per_V / np.abs(
        1.0
        - (omega / model.natural_frequency_rad_per_s) ** 2
        + 2j * model.damping_ratio * omega / model.natural_frequency_rad_per_s
    )

    def draw(axes: list[Axis]) -> None:
        measured = 20.0 * np.log10(np.abs(response.gain_um_per_V))
        axes[0].semilogx(frequency, measured, color=BLUE, label="swept sine")
        axes[0].semilogx(
            frequency, 20.0 * np.log10(fitted), "--", color=ORANGE, label="second order (54)"
        )
        label(axes[0], "frequency / Hz", "magnitude / dB (1 µm/V)")
        legend(axes[0])

    return picture(1, 1, 3.8, draw)


def _map_picture(maps: dict[str, NDArray[np.float64]]) -> bytes:
    levels = [0.0, 0.8, 0.9, LIMIT_RADIUS, 1.0, 1.2, 1.5, 3.0]
    colors = ["#4f9a6c", "#86bd97", "#c3dfc9", "#f5e6a8", "#f0c58e", "#df9270", "#c2614a"]

    def draw(axes: list[Axis]) -> None:
        for axis, (name, radii) in zip(axes, maps.items(), strict=True):
            periods = [1e3 * period_s for period_s in PERIODS_S]
            shown = np.clip(radii.T, 0.0, 2.99)
            axis.contourf(periods, GAINS, shown, levels=levels, colors=colors)
            lines = axis.contour(periods, GAINS, shown, levels=[LIMIT_RADIUS, 1.0], colors=INK)
            axis.clabel(lines, fmt="%g", fontsize=8)
            axis.set_yscale("log")
            axis.set_yticks(GAINS[::3], [f"{gain:g}" for gain in GAINS[::3]])
            axis.minorticks_off()
            label(axis, "period T / ms", "$K_P$", name)

    return picture(1, 2, 4.0, draw)
