"""Fig. 7: the estimator in contact, and the errors of the planned pair before any control."""

from math import pi

import numpy as np
from numpy.typing import NDArray

from pincette.config import RigFile
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters
from pincette.control.response.free_response import FreeResponse
from pincette.plotting import BLUE, GREEN, ORANGE, Axis, label, legend_above, picture
from pincette_study import printed
from pincette_study.estimation import CYCLES, Reading, read
from pincette_study.open_loop import peak_to_peak, raised_sinusoid
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import simulation_of

Series = NDArray[np.float64]


def fig_7(rig: RigFile, response: FreeResponse) -> Section:
    """Drive the arm in contact with the voltage that the planned pair needs on a linear arm."""
    touching = simulation_of(rig).model_copy(update={"bead_contact_um": 0.0})
    s_p, d_p = rig.model.compliance_um_per_mN, rig.model.piezo_um_per_V
    level_V = (printed.X_PP_UM + s_p * printed.FORCE_PP_MN) / d_p
    signal = raised_sinusoid(level_V, printed.FREQUENCY_HZ, CYCLES, rig.rig.period_s)
    reading = read(touching, signal, response, QuasiStatic(QuasiStaticParameters(s_p)))
    x_error_um, force_error_mN = _planning_errors(reading)
    at = int(np.argmax(np.abs(x_error_um)))
    return Section(
        key="fig7",
        title="Fig. 7: the estimator with a contact, and the planned pair",
        text=(
            f"Open loop, {level_V:.2f} V peak to peak, in contact from the start: what "
            f"{printed.X_PP_UM} µm and {printed.FORCE_PP_MN:g} mN ask of a linear arm. The "
            "estimate stands beside the true contact force of the simulated rig, which the paper "
            "could not see.",
            "Planning errors are planned minus actual, in the last cycle, both counted from the "
            "trough where plan and arm agree; the force as the paper gives it, negative. That the "
            "contact is softer than planned is set from the paper's own two numbers; what the "
            "hysteresis adds to them is not.",
        ),
        pictures=(
            Picture("fig7", "Fig. 7 repeated", _picture(reading, x_error_um, force_error_mN)),
        ),
        comparisons=(
            Comparison("estimate against the true force", "mN r.m.s.", None, reading.error_mN),
            Comparison(
                "the same, of the force's peak to peak",
                "%",
                None,
                100.0 * reading.error_mN / peak_to_peak(reading.motion.true_force_mN),
            ),
            Comparison(
                "largest planning error, position",
                "µm",
                printed.PLANNING_ERROR_UM,
                float(x_error_um[at]),
            ),
            Comparison(
                "planning error of the force at that time",
                "mN",
                printed.PLANNING_ERROR_MN,
                float(force_error_mN[at]),
            ),
        ),
    )


def _planning_errors(reading: Reading) -> tuple[Series, Series]:
    """Return planned minus actual over the last cycle: position in µm, negative force in mN."""
    cycle = len(reading.force_mN) // CYCLES
    x_um, force_mN = reading.motion.x_um[-cycle:], reading.force_mN[-cycle:]
    # The position results from the voltage of the previous sample.
    share = 0.5 * (1.0 - np.cos(2.0 * pi * (np.arange(cycle) - 1.0) / cycle))
    x_planned_um = float(np.min(x_um)) + printed.X_PP_UM * share
    planned_mN = float(np.min(force_mN)) + printed.FORCE_PP_MN * share
    return x_planned_um - x_um, -(planned_mN - force_mN)


def _picture(reading: Reading, x_error_um: Series, force_error_mN: Series) -> bytes:
    motion = reading.motion
    t = np.arange(len(reading.force_mN)) * motion.period_s
    cycle_s = np.arange(len(x_error_um)) * motion.period_s

    def draw(axes: list[Axis]) -> None:
        axes[0].plot(t, motion.voltage_V, color=BLUE)
        label(axes[0], "time / s", "voltage / V", "(a)")
        axes[1].plot(t, motion.x_um, color=BLUE)
        label(axes[1], "time / s", "position / µm", "(b)")
        axes[2].plot(t, motion.true_force_mN, color=GREEN, label="true")
        axes[2].plot(t, reading.force_mN, color=BLUE, linewidth=0.9, label="estimated")
        label(axes[2], "time / s", "force / mN", "(c)")
        legend_above(axes[2])
        axes[3].plot(cycle_s, x_error_um, color=BLUE, label="position / µm")
        axes[3].plot(cycle_s, force_error_mN, color=ORANGE, label="negative force / mN")
        label(axes[3], "time in the last cycle / s", "planned minus actual", "(d)")
        legend_above(axes[3])

    return picture(2, 2, 5.6, draw)
