"""Fig. 8: the line of peak-to-peak force over peak-to-peak position, in open loop."""

from pincette.config import RigFile
from pincette.control.calibration.lines import stiffness_line
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters
from pincette.control.response.free_response import FreeResponse
from pincette.plotting import BLUE, ORANGE, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.estimation import CYCLES, read
from pincette_study.open_loop import peak_to_peak, raised_sinusoid
from pincette_study.report import Comparison, Picture, Section
from pincette_study.rigs import simulation_of

OFFSET_MN = printed.FORCE_PP_MN - printed.STIFFNESS_SLOPE_MN_PER_UM * printed.X_PP_UM
"""Offset of the paper's line in Fig. 8 if it passes through the planned pair, in mN."""


def fig_8(rig: RigFile, response: FreeResponse) -> Section:
    """Run Fig. 8: four voltage levels on a part that the arm touches from the start."""
    touching = simulation_of(rig).model_copy(update={"bead_contact_um": 0.0})
    observer = QuasiStatic(QuasiStaticParameters(rig.model.compliance_um_per_mN))
    x_pp_um: list[float] = []
    force_pp_mN: list[float] = []
    for level_V in printed.VOLTAGE_LEVELS_V:
        signal = raised_sinusoid(level_V, printed.FREQUENCY_HZ, CYCLES, rig.rig.period_s)
        reading = read(touching, signal, response, observer)
        cycle = len(signal) // CYCLES
        x_pp_um.append(peak_to_peak(reading.motion.tail(cycle).x_um))
        force_pp_mN.append(peak_to_peak(reading.force_mN[-cycle:]))
    line = stiffness_line(x_pp_um, force_pp_mN)
    contact = simulation_of(rig).environment_stiffness_mN_per_um

    def draw(axes: list[Axis]) -> None:
        reach = [0.0, max(x_pp_um)]
        axes[0].plot(x_pp_um, force_pp_mN, "o", color=BLUE, label="four levels")
        axes[0].plot(reach, [line.at(x) for x in reach], color=BLUE, label="least squares")
        axes[0].plot(
            reach,
            [printed.STIFFNESS_SLOPE_MN_PER_UM * x + OFFSET_MN for x in reach],
            "--",
            color=ORANGE,
            label="paper",
        )
        label(axes[0], "position, peak to peak / µm", "force, peak to peak / mN")
        legend(axes[0])

    slope = printed.STIFFNESS_SLOPE_MN_PER_UM
    return Section(
        key="fig8",
        title="Fig. 8: the line that plans position and force together",
        text=(
            f"The stiffness of the contact is {contact:.2f} mN/µm, by Fig. 7(d) and close to "
            "(55). The paper's 2.47 mN/µm is put down to hysteresis, which makes the arm "
            "move less at a higher rate. That does not explain it: force and position of a "
            "contact are tied by its stiffness whatever the voltage does, and a contact "
            "that is lost at the low end, as the offset of -0.87 mN has it, moves the line "
            "without turning it. A stiffer contact than (55) would, or an estimator that "
            "reads a moving arm as force.",
        ),
        pictures=(Picture("fig8", "Fig. 8 repeated", picture(1, 1, 3.8, draw)),),
        comparisons=(
            Comparison(
                "slope", "mN/µm", slope, line.slope, f"± {2.0 * line.slope_uncertainty:.3f}"
            ),
            Comparison("offset", "mN", OFFSET_MN, line.offset),
            Comparison(
                f"force at {printed.X_PP_UM} µm",
                "mN",
                printed.FORCE_PP_MN,
                line.at(printed.X_PP_UM),
            ),
        ),
        data={"x_pp_um": x_pp_um, "force_pp_mN": force_pp_mN},
    )
