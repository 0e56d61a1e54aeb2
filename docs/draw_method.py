"""Draw the pictures of docs/explanations/method.md: `.venv/bin/python docs/draw_method.py`.

Everything drawn is computed by `pincette.control`, without randomness and without a clock.
"""

from dataclasses import dataclass, replace
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
from draw_laws import laws_picture
from draw_response import following_picture, repeating_picture, response_picture
from draw_step import step_picture

from pincette.control.arm.mode import sample_mode
from pincette.control.arm.plant import consistent_arm
from pincette.control.force.estimation import force
from pincette.control.laws import law as control_law
from pincette.control.laws.steady import steady_state_errors
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import identified_response
from pincette.control.stability.assessment import radius_map
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.worst_case import Intervals
from pincette.plotting import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    Axis,
    label,
    legend,
    picture,
)
from tests.support.laws import law_settings

IMAGES = Path(__file__).resolve().parent / "images"
OMEGA_N, ZETA, D_P, S_P, T = sqrt(5.943e6), 0.0260, 19.0, 0.46, 0.02
ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
K, K_E, FORCE_MN, FILTER_S = 1.9901e4, 2.15, 20.0, 0.03
COLOURS = ("#4f9a6c", "#86bd97", "#c3dfc9", "#f5e6a8", "#f0c58e", "#df9270", "#c2614a")
"""Colours from a fast to an unstable loop."""
STABILITY_TITLE = "worst over free and K_e ± 30 %, ω_n ± 5 %, delay from 0 to T/2"
STIFF = 1.1
"""Ratio of planned to true stiffness for a plan with the wrong stiffness."""


def plan_picture() -> bytes:
    """Draw the part's line, a plan of the right and one of the wrong stiffness, and the steady
    states of the loop.
    """
    return picture(1, 1, 4.0, _plan_line)


def _plan_line(axes: list[Axis]) -> None:
    axis, reach = axes[0], np.array([0.0, 11.0])
    axis.plot(reach, K_E * reach, color=INK, label=f"the part: F = {K_E} mN/µm · (x − x_e)")
    axis.plot(
        reach, STIFF * K_E * reach, color=FAINT, linestyle="--", label="a plan 10 % too stiff"
    )
    x_fit, x_r = FORCE_MN / K_E, FORCE_MN / (STIFF * K_E)
    axis.plot([x_fit], [FORCE_MN], "o", color=GREEN, label="reference that fits: it is reached")
    axis.plot([x_r], [FORCE_MN], "o", color=RED, label="reference that does not: the loop rests at")
    for K_f, colour in ((0.0, BLUE), (2000.0, "#4d83a8"), (5000.0, "#7ba6c2"), (2e4, "#a9c6d8")):
        E_x, E_f = steady_state_errors(
            force_r_mN=FORCE_MN, x_r_um=x_r, x_e_um=0.0, K_e=K_E, K=K, K_f=K_f
        )
        axis.plot([x_r, x_r + E_x], [FORCE_MN, FORCE_MN + E_f], color=colour, linewidth=0.9)
        axis.plot([x_r + E_x], [FORCE_MN + E_f], "s", color=colour, label=f"   K_f = {K_f:g}")
    axis.set_xlim(6.5, 10.5)
    axis.set_ylim(14.5, 22.5)
    label(axis, "x − x_e in µm", "F in mN")
    legend(axis, "lower right")


def exchange_picture() -> bytes:
    """Draw (51) and (52) over K_f for the plan with the wrong stiffness."""
    return picture(1, 1, 3.4, _exchange)


def _exchange(axes: list[Axis]) -> None:
    axis, x_r = axes[0], FORCE_MN / (STIFF * K_E)
    gains = np.linspace(0.0, 20000.0, 101)
    errors = np.array(
        [
            steady_state_errors(
                force_r_mN=FORCE_MN, x_r_um=x_r, x_e_um=0.0, K_e=K_E, K=K, K_f=float(K_f)
            )
            for K_f in gains
        ]
    )
    x_line = axis.plot(gains, errors[:, 0], color=BLUE)
    other = axis.twinx()
    F_line = other.plot(gains, -errors[:, 1], color=ORANGE)
    axis.set_ylim(0.0, 0.9)
    other.set_ylim(0.0, 0.9 * K_E)
    other.tick_params(colors=INK, labelsize=8.5, length=3)
    other.spines["top"].set_visible(False)
    axis.axvline(5000.0, color=FAINT, linewidth=0.9)
    axis.text(5150.0, 0.83, "paper: K/K_f = 4 mN/µm", fontsize=8.5, color=INK)
    label(axis, "K_f (K = 19 901 mN/µm)", "position error E_x in µm")
    other.set_ylabel("force error −E_f in mN", fontsize=9.5, color=INK)
    names = ["position, further in than planned", "force, less than planned"]
    axis.legend([*x_line, *F_line], names, fontsize=8.5, frameon=False, loc="center right")


@dataclass(frozen=True, slots=True)
class Track:
    """Simulated signals of a law while the arm is pressed; N samples each."""

    t_s: np.ndarray
    x_um: np.ndarray
    x_r_um: np.ndarray
    force_mN: np.ndarray
    force_r_mN: np.ndarray


def track(planned_mN_per_um: float, seconds: float = 4.0) -> Track:
    """Simulate F_r from 0 to 20 mN and back at 0.5 Hz; x_r is on a line of the planned stiffness.

    The arm has hysteresis of 15 % and creep; the estimator's model of it has weights that are 2 %
    too large and no creep.
    """
    actuator = HysteresisModel(
        thresholds_V=(0.0, 0.1, 0.2, 0.4, 0.7),
        weights_um_per_V=(11.0, 2.0, 2.0, 2.0, 2.0),
        creep_times_s=(0.5, 5.0),
        creep_fractions=(0.01, 0.01),
    )
    known = replace(
        actuator,
        weights_um_per_V=tuple(1.02 * weight for weight in actuator.weights_um_per_V),
        creep_times_s=(),
        creep_fractions=(),
    )
    true = identified_response(actuator, D_P, 0.0).updated(1.0, 60.0)
    x_e_um = true.position_um()
    model = identified_response(known, D_P, 0.0).updated(1.0, T).begin(x_e_um)
    settings = law_settings(K_P=1.0, K_f=5000.0)
    law = control_law.build(settings, ARM, T, FILTER_S)
    ratio = K_E * S_P
    mode = sample_mode(OMEGA_N * sqrt(1.0 + ratio), ZETA / sqrt(1.0 + ratio), T)
    x_um, speed, voltage_V = x_e_um, 0.0, 1.0
    state = control_law.start(law, x_um=x_um, x_r_um=x_um, force_mN=0.0, applied_V=voltage_V)
    rows: list[tuple[float, ...]] = []
    for tick in range(round(seconds / T)):
        # A fixed pattern that replaces the sensor noise, 30 nm r.m.s.
        measured_um = x_um + 0.0424 * sin(2.4 * tick * tick)
        F_r_mN = 0.5 * FORCE_MN * (1.0 - cos(pi * (tick + 1) * T))
        x_r_um = x_e_um + F_r_mN / planned_mN_per_um
        state, output = control_law.step(
            law,
            state,
            x_um=measured_um,
            force_mN=force(measured_um, model.position_um(), S_P),
            applied_V=voltage_V,
            x_r_um=x_r_um,
            force_r_mN=F_r_mN,
            limited=0,
        )
        voltage_V = output.voltage_V
        true, model = true.updated(voltage_V, T), model.updated(voltage_V, T)
        rest_um = (true.position_um() + ratio * x_e_um) / (1.0 + ratio)
        off_um, v = x_um - rest_um, speed
        x_um = rest_um + mode.xx * off_um + mode.xv * v
        speed = mode.vx * off_um + mode.vv * v
        rows.append(((tick + 1) * T, x_um - x_e_um, x_r_um - x_e_um, K_E * (x_um - x_e_um), F_r_mN))
    t, x, x_r, F, F_r = (np.array(column) for column in zip(*rows, strict=True))
    return Track(t, x, x_r, F, F_r)


def track_picture() -> bytes:
    """Draw the force over time, and both errors for plans of the right and the wrong stiffness."""
    fits, stiff = track(K_E), track(STIFF * K_E)

    def draw(axes: list[Axis]) -> None:
        axes[0].plot(fits.t_s, fits.force_r_mN, color=FAINT, linewidth=3.0, label="F_r")
        axes[0].plot(fits.t_s, fits.force_mN, color=ORANGE, label="F, true")
        for run, colour, name in ((stiff, RED, "plan 10 % too stiff"), (fits, GREEN, "plan fits")):
            axes[1].plot(run.t_s, run.x_um - run.x_r_um, color=colour, linewidth=1.1, label=name)
            error_mN = run.force_mN - run.force_r_mN
            axes[2].plot(run.t_s, error_mN, color=colour, linewidth=1.1, label=name)
        label(axes[0], "t in s", "force in mN", "a plan that fits")
        label(axes[1], "t in s", "x − x_r in µm", "position error")
        label(axes[2], "t in s", "F − F_r in mN", "force error")
        for axis, top in zip(axes, (27.0, 0.95, 1.9), strict=True):
            legend(axis, "upper left")
            axis.set_ylim(top=top)

    return picture(1, 3, 3.3, draw)


def stability_picture() -> bytes:
    """Draw the worst spectral radius of PBSMIC over period and K_P."""
    periods_s, gains = np.geomspace(0.003, 0.03, 25), np.geomspace(0.1, 10.0, 15)
    loop = Loop(law_settings(), ARM, T, FILTER_S)
    radii = radius_map(
        loop,
        Intervals(K_e_mN_per_um=(0.7 * K_E, 1.3 * K_E)),
        periods_s=[float(value) for value in periods_s],
        gains=[float(value) for value in gains],
    )

    def draw(axes: list[Axis]) -> None:
        levels = (0.5, 0.8, 0.9, 0.97, 1.0, 1.2, 1.5)
        filled = axes[0].contourf(
            1e3 * periods_s, gains, radii.T, levels=levels, colors=COLOURS, extend="max"
        )
        lines = axes[0].contour(
            1e3 * periods_s, gains, radii.T, levels=(0.97,), colors=INK, linewidths=1.4
        )
        axes[0].clabel(lines, fmt="limit 0.97", fontsize=8)
        axes[0].set_xscale("log")
        axes[0].set_yscale("log")
        axes[0].set_xticks([3, 5, 10, 20, 30], ["3", "5", "10", "20", "30"])
        axes[0].set_yticks([0.1, 0.5, 1, 2, 5, 10], ["0.1", "0.5", "1", "2", "5", "10"])
        axes[0].minorticks_off()
        axes[0].figure.colorbar(filled, ax=axes[0], label="worst spectral radius")
        label(axes[0], "period T in ms", "K_P (K_I = 1)", STABILITY_TITLE)

    return picture(1, 1, 4.0, draw)


PICTURES = {
    "method-step": step_picture,
    "method-plan": plan_picture,
    "method-exchange": exchange_picture,
    "method-track": track_picture,
    "method-response": response_picture,
    "method-following": following_picture,
    "method-repeating": repeating_picture,
    "method-stability": stability_picture,
    "method-laws": laws_picture,
}


def main() -> None:
    """Draw every picture."""
    for name, draw in PICTURES.items():
        path = IMAGES / f"{name}.png"
        path.write_bytes(draw())
        print(path.relative_to(IMAGES.parents[1]), f"{path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
