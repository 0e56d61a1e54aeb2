"""``pincette teach``: identify the free response of a rig from a free motion of its arm."""

import sys
from pathlib import Path

from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.config import RigFile
from pincette.control.identification import (
    Candidates,
    Identification,
    identify_free_response,
    spread_fadings,
)
from pincette.control.teaching import teaching_program
from pincette.messages import Estimate
from pincette.runtime.composed import ComposedLoop

SPEED_FACTOR = 3.0
"""Fastest part of the motion against the approach; the paper's widest sinusoid needs it."""
BELOW_REST = 0.1
"""How far the motion goes beyond the rest position, as a share of its height above it."""


def teach(path: Path, write: Path | None) -> int:
    """Print the table of an identified free response, and write it where asked."""
    rig = opened(path)
    if rig.simulation is None:
        raise CliError(
            f"{path} has no [simulation]: teaching on hardware comes with calibration "
            "and is not there yet"
        )
    found = identify(rig)
    residual_mN = found.residual_um / rig.model.compliance_um_per_mN
    table = as_toml(found)
    sys.stdout.write(
        f"# residual on motion not fitted: {found.residual_um:.3f} µm r.m.s., "
        f"as force {residual_mN:.2f} mN\n{table}"
    )
    if write is not None:
        write.write_text(table, encoding="utf-8")
    return 0


def identify(rig: RigFile) -> Identification:
    """Move the simulated arm with the part taken out, and identify its free response.

    Raises
    ------
    CliError
        Where the rig file describes no simulation, or its motion admits no model.
    """
    low_um, high_um = free_range_um(rig)
    try:
        program = teaching_program(low_um, high_um, SPEED_FACTOR * rig.grip.approach_um_per_s)
        estimates = [
            message
            for message in ComposedLoop(without_part(rig)).play(program)
            if isinstance(message, Estimate) and message.valid
        ]
        voltages_V = [estimate.applied_V for estimate in estimates]
        return identify_free_response(
            voltages_V,
            [estimate.x_um for estimate in estimates],
            rig.rig.period_s,
            candidates=Candidates(
                spread_fadings(max(voltages_V) - min(voltages_V)), curved=(False, True)
            ),
        )
    except ValueError as error:
        raise CliError(f"the free response could not be identified: {error}") from error


def without_part(rig: RigFile) -> RigFile:
    """Return the rig in lockstep with nothing to touch and nothing taught."""
    simulation = rig.simulation
    return rig.model_copy(
        update={
            "rig": rig.rig.model_copy(update={"time": "lockstep"}),
            "model": rig.model.model_copy(update={"free_response": None}),
            "simulation": simulation and simulation.model_copy(update={"bead": False}),
        }
    )


def free_range_um(rig: RigFile) -> tuple[float, float]:
    """Range of free positions whose voltages cover a grip of the rig file, in its limits.

    The arm presses with F at x_e + F/K_e where, free, it would be s_p·F further.
    """
    part, force_mN = rig.part, rig.grip.force_mN
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    pressed_um = part.contact_um + part.contact_tolerance_um + force_mN / softest
    high_um = pressed_um + rig.model.compliance_um_per_mN * force_mN
    return (
        max(-BELOW_REST * high_um, rig.limits.position_min_um),
        min(high_um, rig.limits.position_max_um),
    )


def as_toml(found: Identification) -> str:
    """Return the table ``[model.free_response]``, rounded to what the residual bears."""
    model = found.model
    parts = ""
    if model.fading_per_V != 0.0:
        parts += f"fading_per_V = {round(model.fading_per_V, 4)}\n"
    if model.curvature_um_per_V2 != 0.0:
        parts += f"curvature_um_per_V2 = {round(model.curvature_um_per_V2, 4)}\n"
    return (
        "[model.free_response]           # by `pincette teach`\n"
        f"thresholds_V = {_array(model.thresholds_V, 3)}\n"
        f"weights_um_per_V = {_array(model.weights_um_per_V, 4)}\n"
        f"creep_times_s = {_array(model.creep_times_s, 3)}\n"
        f"creep_fractions = {_array(model.creep_fractions, 5)}\n"
        f"{parts}residual_um = {found.residual_um:.3f}\n"
    )


def _array(values: tuple[float, ...], digits: int) -> str:
    return f"[{', '.join(str(round(value, digits)) for value in values)}]"
