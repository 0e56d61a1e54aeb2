"""The voltages of a calibration as they are predicted, segment by segment; pure.

Where a law leads the arm they are by the nominal gain alone, u = (x - x_start + s_p·F)/d_p.
"""

from pincette.api.plans import PlannedPhase
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.program import Program
from pincette.control.planning.segments import (
    Move,
    PlayedSweep,
    Press,
    Seek,
    Segment,
    voltage_paths,
)


def planned_phases(
    program: Program, rig: PlannedRig, contact_um: float, rest_V: float
) -> tuple[list[PlannedPhase], float, float]:
    """Return phases of a program, its lowest and its highest voltage.

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
        led_V: float | None = None
        if isinstance(segment, Seek):
            led_V = pressed_V(program.guards.contact_force_mN)
        elif isinstance(segment, Press) and segment.to_mN is not None:
            led_V = pressed_V(segment.to_mN)
        elif isinstance(segment, Move) and segment.to_um[0] is not None:
            led_V = (segment.to_um[0] - rig.x_start_um) / rig.piezo_um_per_V
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
    paths = voltage_paths(segment)
    if paths:
        path, base_V = paths[0], from_V if paths[0].relative else 0.0
        found = peaks(path)
        end_V = base_V + path.at(path.duration_s)
        return base_V + found.lowest, base_V + found.highest, end_V
    if isinstance(segment, PlayedSweep):
        return from_V - segment.sweep.amplitude_V, from_V + segment.sweep.amplitude_V, from_V
    to_V = from_V if led_V is None else led_V
    return min(from_V, to_V), max(from_V, to_V), to_V
