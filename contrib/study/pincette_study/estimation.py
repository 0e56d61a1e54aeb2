"""Fig. 6: the force estimator without contact, and the sources of its errors."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi, sin

import numpy as np
from numpy.typing import NDArray

from pincette.config import RigFile, Simulation
from pincette.control.force.observers import ForceObserver, QuasiStatic, QuasiStaticParameters
from pincette.control.response.free_response import FreeResponse, FreeSample, nominal_response
from pincette.control.response.recorded_response import recorded_response
from pincette.control.response.recording import record_free_response
from pincette.engine.teaching import free_motion
from pincette.plotting import BLUE, ORANGE, Axis, label, picture
from pincette_study import printed
from pincette_study.closed_loop import rms
from pincette_study.open_loop import Motion, drive, peak_to_peak, raised_sinusoid
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import loop_percent, simulation_of

Series = NDArray[np.float64]

REST_S = 1.0
"""Duration of the rest before a signal, in s; the force is zeroed at its end."""
CYCLES = 6
PAPER_SIGNAL = "sinusoid 0.5 Hz"


@dataclass(frozen=True, slots=True)
class Reading:
    """Motion after the initial rest, with the estimated force."""

    motion: Motion
    force_mN: Series

    @property
    def error_mN(self) -> float:
        """Return the r.m.s. error against the true force, in mN."""
        return rms(self.force_mN - self.motion.true_force_mN)


def read(
    simulation: Simulation,
    signal_V: Sequence[float],
    response: FreeResponse,
    observer: ForceObserver,
    period_s: float = printed.PERIOD_S,
) -> Reading:
    """Drive a rig with a voltage that was not used for the identification, and estimate the force.

    The rig rests first, and the force is zeroed there.
    """
    rest = round(REST_S / period_s)
    motion = drive(simulation, [0.0] * rest + list(signal_V), period_s)
    samples: list[FreeSample] = []
    force_mN: list[float] = []
    for index, (u, x) in enumerate(
        zip(motion.voltage_V.tolist(), motion.x_um.tolist(), strict=True)
    ):
        response = response.updated(u, period_s)
        if index < rest:
            samples.append(response.sample(x))
            continue
        if index == rest:
            response = response.rezero(samples, rest // 2)
            observer = observer.restart(x, response.position_um(), u)
        observer, F = observer.observe(x, response.position_um(), u)
        force_mN.append(F)
    return Reading(motion.tail(len(force_mN)), np.array(force_mN))


def unseen_signals(period_s: float) -> dict[str, list[float]]:
    """Return voltages of 2 V peak to peak that the identification motion does not contain."""
    level = printed.VOLTAGE_LEVELS_V[-1]
    count = round(CYCLES / (printed.FREQUENCY_HZ * period_s))
    t = [index * period_s for index in range(count)]

    def shaped(value: Callable[[float], float]) -> list[float]:
        return [value(at) for at in t]

    return {
        PAPER_SIGNAL: raised_sinusoid(level, printed.FREQUENCY_HZ, CYCLES, period_s),
        "triangle 0.3 Hz": shaped(lambda at: level * (1.0 - abs(1.0 - (at * 0.6) % 2.0))),
        "fading sinusoid 1 Hz": shaped(
            lambda at: 0.5 * level * (1.0 + sin(2 * pi * at - pi / 2) * (1.0 - 0.7 * at / t[-1]))
        ),
        "two sines 0.37 and 1.3 Hz": shaped(
            lambda at: 0.5 * level * (1.0 + 0.6 * sin(2.32 * at - 1.5) + 0.39 * sin(8.2 * at))
        ),
    }


def fig_6(rig: RigFile, sources: dict[str, FreeResponse]) -> tuple[Section, dict[str, float]]:
    """Run Fig. 6: the estimator without contact, its sources of x_1, and the sample ages in (53).

    ``sources`` are given by name; the first one is that used in the other figures.
    """
    free = simulation_of(rig).model_copy(update={"bead": False})
    s_p, d_p = rig.model.compliance_um_per_mN, rig.model.piezo_um_per_V
    matched = QuasiStatic(QuasiStaticParameters(s_p))
    signals = unseen_signals(rig.rig.period_s)
    best = next(iter(sources.values()))
    readings = {name: read(free, signal, best, matched) for name, signal in signals.items()}
    first = readings[PAPER_SIGNAL]
    errors = {name: reading.error_mN for name, reading in readings.items()}
    rows = [
        Comparison(
            f"{name}, no contact",
            "mN r.m.s.",
            printed.ESTIMATOR_FREE_RMSE_MN if reading is first else None,
            reading.error_mN,
        )
        for name, reading in readings.items()
    ]
    sinusoid = signals[PAPER_SIGNAL]
    rows += [
        Comparison(
            f"sinusoid 0.5 Hz, x_1 from {name}",
            "mN r.m.s.",
            None,
            read(free, sinusoid, response, matched).error_mN,
        )
        for name, response in list(sources.items())[1:]
    ]
    for name, parameters in {
        "x_1 of the newest voltage, which x does not know yet": QuasiStaticParameters(
            s_p, newest_voltage=True
        ),
        "the same with the term d_p/s_p·[u(t) - u(t - T)] as printed": QuasiStaticParameters(
            s_p, newest_voltage=True, printed_um_per_V=d_p
        ),
        "matched ages with the printed term": QuasiStaticParameters(s_p, printed_um_per_V=d_p),
    }.items():
        reading = read(free, sinusoid, best, QuasiStatic(parameters))
        rows.append(Comparison(f"sinusoid 0.5 Hz, {name}", "mN r.m.s.", None, reading.error_mN))
    rows.append(Comparison("hysteresis loop at 2 V", "% of stroke", None, loop_percent(free)))
    settled = first.motion.tail(len(first.force_mN) // CYCLES)
    gain = peak_to_peak(settled.true_x_um) / printed.VOLTAGE_LEVELS_V[-1]
    rows.append(Comparison("gain at 2 V", "µm/V", printed.PIEZO_UM_PER_V, gain))
    section = Section(
        key="fig6",
        title="Fig. 6: the force estimator without a contact",
        text=(
            "The arm is free, so that every reading is an error. x_1 is the identified response "
            "(play operators and creep), taught by another motion than the signals here; the "
            "rig's own hysteresis is Bouc-Wen.",
            "Position k belongs to the voltage applied at k - 1. An x_1 of the newest voltage "
            "reads every move of the arm as force, and the sample-and-hold term of (53), with its "
            "printed sign, doubles that.",
        ),
        pictures=(Picture("fig6", "Fig. 6 repeated: free arm, 2 V, 0.5 Hz", _fig_6(first)),),
        comparisons=tuple(rows),
        data={"rmse_mN": errors},
    )
    return section, errors


def _fig_6(reading: Reading) -> bytes:
    motion = reading.motion
    t = np.arange(len(reading.force_mN)) * motion.period_s

    def draw(axes: list[Axis]) -> None:
        axes[0].plot(t, motion.voltage_V, color=BLUE)
        label(axes[0], "time / s", "voltage / V", "(a)")
        axes[1].plot(t, motion.x_um, color=BLUE)
        label(axes[1], "time / s", "position / µm", "(b)")
        axes[2].plot(motion.voltage_V, motion.x_um, color=BLUE, linewidth=0.9)
        label(axes[2], "voltage / V", "position / µm", "(c)")
        axes[3].plot(t, reading.force_mN, color=BLUE, linewidth=0.9)
        axes[3].axhline(0.0, color=ORANGE, linestyle="--")
        label(axes[3], "time / s", "estimated force / mN", "(d)")

    return picture(2, 2, 5.4, draw)


def other_sources(rig: RigFile) -> dict[str, FreeResponse]:
    """Return a straight line and a recorded loop, from the same motion as the identified model."""
    voltage_V, x_um = free_motion(rig)
    recording = record_free_response(voltage_V, x_um)
    d_p = rig.model.piezo_um_per_V
    return {
        "a straight line": nominal_response(d_p, FreeSample(0.0, 0.0)),
        "recorded branches": recorded_response(recording.branches, d_p, recording.residual_um),
    }
