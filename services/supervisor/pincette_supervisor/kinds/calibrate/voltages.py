"""The voltages of a calibration as they are predicted, segment by segment; pure.

Where a law leads the arm they are by the nominal gain alone, u = (x - x_start + s_p·F)/d_p.
"""

from pincette.api.plans import PlannedPhase
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.program import Program, Segment


def planned_phases(
    program: Program, rig: PlannedRig, contact_um: float, rest_V: float
) -> tuple[list[PlannedPhase], float, float]:
    """Phases of a program, its lowest and its highest voltage.

    Parameters
    ----------
    contact_um
        Where a part is expected.
    rest_V
        Voltage at which it begins.
    """

    def pressed_V(force_mN: float) -> float:
        x_um = contact_um + force_mN / program.contact_stiffness_mN_per_um
        return (x_um - rig.x_start_um + rig.compliance_um_per_mN * force_mN) / rig.piezo_um_per_V

    phases: list[PlannedPhase] = []
    start_s, voltage_V = 0.0, rest_V
    low_V = high_V = rest_V
    for segment in program.segments:
        force_mN = segment.force_to_mN
        if segment.kind == "seek":
            force_mN = program.guards.contact_force_mN
        led_V = None if force_mN is None else pressed_V(force_mN)
        if led_V is None and segment.x_to_um is not None:
            led_V = (segment.x_to_um - rig.x_start_um) / rig.piezo_um_per_V
        lowest_V, highest_V, voltage_V = _voltages(segment, voltage_V, led_V)
        low_V, high_V = min(low_V, lowest_V), max(high_V, highest_V)
        phases.append(
            PlannedPhase(
                phase=segment.phase,
                start_s=start_s,
                duration_s=segment.duration_s,
                x_um=None,
                force_mN=None,
                voltage_V=voltage_V,
            )
        )
        start_s += segment.duration_s or 0.0
    return phases, low_V, high_V


def _voltages(segment: Segment, from_V: float, led_V: float | None) -> tuple[float, float, float]:
    """Lowest, highest and last voltage of a segment; ``led_V`` is where a law leads it."""
    if segment.path is not None:
        base_V = from_V if segment.path.relative else 0.0
        found = peaks(segment.path)
        end_V = base_V + segment.path.at(segment.path.duration_s)
        return base_V + found.lowest, base_V + found.highest, end_V
    if segment.sweep is not None:
        return from_V - segment.sweep.amplitude_V, from_V + segment.sweep.amplitude_V, from_V
    to_V = from_V if led_V is None else led_V
    return min(from_V, to_V), max(from_V, to_V), to_V
