"""Draw the free response in a law, the tracking of the contact line, and learning, for
docs/draw_method.py.

An arm with a free response is pressed against a spring; its mode is not simulated: x follows the
voltage of the previous tick. The law uses H with weights that are 3 % off, or a line. Nothing is
random.
"""

from dataclasses import dataclass, replace
from math import cos, pi, sin, sqrt

import numpy as np

from pincette.control.arm.plant import consistent_arm
from pincette.control.laws import law as control_law
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import MOST_STIFFNESS, line_share, stiffest_line
from pincette.control.planning.profiles import move
from pincette.control.planning.repetition import CycleLearner, no_corrections
from pincette.control.response import hysteresis
from pincette.control.response.hysteresis import HysteresisModel, displacement_um
from pincette.plotting import BLUE, FAINT, GREEN, INK, ORANGE, RED, Axis, label, legend, picture
from tests.support.laws import default_settings, law_settings

OMEGA_N, ZETA, D_P, S_P, T = sqrt(5.943e6), 0.0260, 19.0, 0.46, 0.02
ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
K_E, FORCE_MN, FILTER_S = 2.15, 20.0, 0.03
ACTUATOR = HysteresisModel(
    thresholds_V=(0.0, 0.1, 0.2, 0.4, 0.7),
    weights_um_per_V=(11.0, 2.0, 2.0, 2.0, 2.0),
    creep_times_s=(0.5, 5.0),
    creep_fractions=(0.01, 0.01),
)
KNOWN = replace(ACTUATOR, weights_um_per_V=(11.3, 2.1, 1.9, 2.1, 1.9))
"""Free-response model that the law uses."""
LAGGING = 0.1
"""Fraction of a voltage step that arrives one tick late, as with an output lag."""


@dataclass(frozen=True, slots=True)
class Cycles:
    """Recorded ticks at full amplitude."""

    t_s: np.ndarray
    error_um: np.ndarray
    learned_um: np.ndarray


def tracked(frequency_hz: float, cycles: int, *, identified: bool, learns: bool = False) -> Cycles:
    """Simulate F_r from 0 to 20 mN and back, x_r on the line of the part; return the true force."""
    settings = default_settings("pbsmic", "identified") if identified else law_settings(K_f=2000.0)
    law = control_law.build(settings, ARM, T, FILTER_S, KNOWN if identified else None)
    ratio, ticks = K_E * S_P, round(1.0 / (frequency_hz * T))
    true = hysteresis.step(ACTUATOR, hysteresis.start(ACTUATOR), 1.0, 60.0)
    known = hysteresis.step(KNOWN, hysteresis.start(KNOWN), 1.0, 60.0)
    x_e_um = x_um = displacement_um(ACTUATOR, true)
    voltage_V, before_um = 1.0, x_e_um
    state = control_law.start(
        law, x_um=x_um, x_r_um=x_um, force_mN=0.0, applied_V=voltage_V, memory=known
    )
    learner = CycleLearner(no_corrections(ticks))
    rows: list[tuple[float, float, float]] = []
    for tick in range(ticks * cycles):
        force_r_mN = 0.5 * FORCE_MN * (1.0 - cos(2.0 * pi * (tick + 1) / ticks))
        x_r_um = x_e_um + force_r_mN / K_E
        learned_um = learner.corrections.at(tick) if learns else 0.0
        state, output = control_law.step(
            law,
            state,
            x_um=x_um,
            force_mN=K_E * (x_um - x_e_um),
            applied_V=voltage_V,
            x_r_um=x_r_um + learned_um,
            force_r_mN=force_r_mN,
            limited=0,
            memory=known if identified else None,
        )
        voltage_V = output.voltage_V
        true = hysteresis.step(ACTUATOR, true, voltage_V, T)
        known = hysteresis.step(KNOWN, known, voltage_V, T)
        free_um = displacement_um(ACTUATOR, true)
        late_um = free_um + LAGGING * (before_um - free_um)
        x_um, before_um = (late_um + ratio * x_e_um) / (1.0 + ratio), free_um
        learner = learner.updated(tick, x_um - x_r_um, limited=False)
        rows.append(((tick + 1) * T, x_um - x_r_um, learned_um))
    t, error, learned = (np.array(column) for column in zip(*rows, strict=True))
    return Cycles(t, error, learned)


def response_picture() -> bytes:
    """Draw H and the line, and the remaining error with each of them."""

    def draw(axes: list[Axis]) -> None:
        swings = [1.0 - cos(2.0 * pi * tick / 100) for tick in range(300)]
        small = [1.0 + 0.3 * sin(2.0 * pi * tick / 100) for tick in range(200)]
        state, x_um = hysteresis.start(ACTUATOR), list[float]()
        for u in (*swings, *small):
            state = hysteresis.step(ACTUATOR, state, u, T)
            x_um.append(displacement_um(ACTUATOR, state))
        voltage_V = np.array((*swings, *small))
        axes[0].plot(voltage_V, x_um, color=BLUE, linewidth=1.2, label="H(u): loops and creep")
        axes[0].plot((0.0, 2.0), (0.0, 2.0 * D_P), "--", color=ORANGE, label="the line d/k · u")
        label(axes[0], "u in V", "free position in µm")
        legend(axes[0], "upper left")
        for axis, frequency_hz in zip(axes[1:], (0.5, 2.0), strict=True):
            ticks = round(1.0 / (frequency_hz * T))
            for identified, colour, name in (
                (False, ORANGE, "d·u in (17)"),
                (True, BLUE, "k·H(u)"),
            ):
                run = tracked(frequency_hz, 4, identified=identified)
                last = slice(-2 * ticks, None)
                axis.plot(run.t_s[last], run.error_um[last], color=colour, label=name)
            label(axis, "t in s", "x − x_r in µm", f"{frequency_hz:g} Hz")
            legend(axis, "upper right")
            axis.set_ylim(top=1.5 * axis.get_ylim()[1])

    return picture(1, 3, 3.3, draw)


def following_picture() -> bytes:
    """Draw loads of a part twice as stiff as planned, with and without tracking of the contact
    line.
    """

    def draw(axes: list[Axis]) -> None:
        planned, true, speed, load_s = 0.5 * K_E, K_E, 40.0, 0.4
        for follows, colour, name in (
            (False, RED, "line as planned"),
            (True, GREEN, "line followed"),
        ):
            K_line = MOST_STIFFNESS * planned if follows else planned
            # Both begin at contact.
            x_line, line = 5.0 / true - 5.0 / K_line, ContactLine()
            way = move(5.0, planned * speed, FORCE_MN, 0.0, load_s)
            rows: list[tuple[float, float, float]] = []
            for tick in range(round(load_s / T) + 1):
                force_r_mN = way.position(tick * T)
                x_um = x_line + force_r_mN / K_line
                force_mN = true * x_um
                line = line.add(x_um, force_mN, force_r_mN)
                rows.append((tick * T, force_mN, K_line))
                if follows:
                    found = stiffest_line(line, MOST_STIFFNESS * planned, 0.0, S_P)
                    K_line += line_share(T) * (found.K_e_mN_per_um - K_line)
                    x_line += line_share(T) * (found.x_e_um - x_line)
            t_s, force, stiffness = np.array(rows).T
            axes[0].plot(t_s, force, color=colour, label=name)
            axes[1].plot(t_s, stiffness, color=colour, label=name)
        axes[0].plot(
            t_s, [way.position(t) for t in t_s], "--", color=INK, linewidth=0.9, label="F_r"
        )
        axes[1].axhline(true, color=FAINT, linestyle="--", label="the part")
        label(axes[0], "t since the touch in s", "force in mN")
        label(axes[1], "t since the touch in s", "K_e of the references in mN/µm")
        for axis in axes:
            legend(axis, "lower right" if axis is axes[0] else "center right")

    return picture(1, 2, 3.3, draw)


def repeating_picture() -> bytes:
    """Draw the model error along a cycle, and learning at 5 Hz."""

    def draw(axes: list[Axis]) -> None:
        voltages = [1.0 + 0.4 * sin(2.0 * pi * tick / 100) for tick in range(400)]
        true, known, missed = hysteresis.start(ACTUATOR), hysteresis.start(KNOWN), list[float]()
        for u in voltages:
            true = hysteresis.step(ACTUATOR, true, u, T)
            known = hysteresis.step(KNOWN, known, u, T)
            missed.append(displacement_um(ACTUATOR, true) - displacement_um(KNOWN, known))
        last = np.array(missed[-200:]) - missed[-200]
        axes[0].plot(np.arange(200) * T, last / S_P, color=BLUE)
        label(axes[0], "t in s", "r/s_p in mN", "what H misses, as a force: the same in each cycle")
        run = tracked(5.0, 12, identified=True, learns=True)
        by_cycle = run.error_um.reshape(12, -1)
        errors = np.sqrt(np.mean(by_cycle**2, axis=1))
        axes[1].plot(np.arange(1, 13), errors, "o-", color=GREEN, markersize=4)
        axes[1].set_ylim(bottom=0.0)
        label(axes[1], "cycle", "RMS of x − x_r in µm", "learning at 5 Hz, behind a lagging output")

    return picture(1, 2, 3.3, draw)
