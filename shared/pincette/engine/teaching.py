"""Free response of a simulated rig: moves the arm without the part, and identifies it."""

from pincette.config import RigFile
from pincette.control.planning.teaching import teaching_program
from pincette.control.record import replace
from pincette.control.response.identification import (
    ALL,
    Identification,
    identify_free_response,
)
from pincette.control.response.recording import Recording, record_free_response
from pincette.core.faults import Outcome
from pincette.core.messages import Estimate, Telemetry
from pincette.engine.composed import ComposedLoop

SPEED_FACTOR = 3.0
"""Ratio of the largest speed of the motion to that of the approach; the paper's widest sinusoid
needs it.
"""
LARGEST_RESIDUAL = 0.005
"""Largest accepted residual of a model, relative to the range. An arm without history gives 0.2 %.
If relays with wide loops are set when the arm is switched on, the residual is 1 to 3 %.
"""
BELOW_REST = 0.1
"""Distance by which the motion goes below the rest position, relative to the distance by which it
goes above."""


def teach(rig: RigFile, *, to_limits: bool = False) -> Identification:
    """Move the simulated arm freely and identify its free response, as that of an arm without
    history.

    ``to_limits``: move up to the highest position, as needed for an arm that also moves its part.

    Raises
    ------
    ValueError
        The motion does not end, or the model's residual is above ``LARGEST_RESIDUAL``.
    """
    voltage_V, x_um = free_motion(rig, to_limits=to_limits)
    # A simulated arm of the Bouc-Wen class would be identified by its own equation.
    plays = ALL._replace(beside=())
    found = identify_free_response(voltage_V, x_um, rig.rig.period_s, candidates=plays)
    limit_um = LARGEST_RESIDUAL * (max(x_um) - min(x_um))
    if found.residual_um > limit_um:
        raise ValueError(
            f"the residual of the model is {found.residual_um:.3f} µm r.m.s., limit "
            f"{limit_um:.3f} µm: {100.0 * LARGEST_RESIDUAL:g} % of the range. Teaching "
            "assumes an arm without earlier voltages, and this one seems to have had some: "
            "run `pincette job calibrate free_response`, which conditions it first; use "
            "`--arm 2` for the second of two arms"
        )
    return found


def record(rig: RigFile, *, to_limits: bool = False) -> Recording:
    """Move the simulated arm freely and record the branches of its response; raises ValueError."""
    return record_free_response(*free_motion(rig, to_limits=to_limits))


def free_motion(rig: RigFile, *, to_limits: bool = False) -> tuple[list[float], list[float]]:
    """Return voltages and positions, of equal ages, of the teaching motion; raises as ``teach``."""
    low_um, high_um = free_range_um(rig)
    if to_limits:
        high_um = rig.limits.position_max_um
        low_um = max(-BELOW_REST * high_um, rig.limits.position_min_um)
    program = teaching_program(low_um, high_um, SPEED_FACTOR * rig.grip.approach_um_per_s)
    # Before the response is identified, the estimated force of a free arm is some mN, so the rig's
    # own limit would end the motion.
    guards = replace(program.guards, force_max_mN=rig.limits.force_max_mN)
    estimates: list[Estimate] = []
    outcome = Outcome.NONE
    for message in ComposedLoop(without_part(rig)).play(replace(program, guards=guards)):
        if isinstance(message, Estimate) and message.valid:
            estimates.append(message)
        elif isinstance(message, Telemetry):
            outcome = message.outcome
    if outcome != Outcome.MOVED:
        raise ValueError(
            f"the free motion ended as {outcome.value!r} after {len(estimates)} samples, it "
            f"must end as {Outcome.MOVED.value!r}: raise the limit of the rig file that "
            "ended it"
        )
    return [item.arms[0].applied_V for item in estimates], [item.arms[0].x_um for item in estimates]


def without_part(rig: RigFile) -> RigFile:
    """Return the rig in lockstep, without a part and without an identified model."""
    simulation = rig.simulation
    return rig.model_copy(
        update={
            "rig": rig.rig.model_copy(update={"time": "lockstep"}),
            "model": rig.model.model_copy(
                update={"free_response": None, "recorded_response": None}
            ),
            "simulation": simulation and simulation.model_copy(update={"bead": False}),
        }
    )


def free_range_um(rig: RigFile) -> tuple[float, float]:
    """Return the range of free positions whose voltages cover a grip of the rig file.

    The arm presses with F at x_e + F/K_e; with the same voltage, a free arm would be s_p·F further.
    """
    part, force_mN = rig.part, rig.grip.force_mN
    softest = part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    pressed_um = part.contact_um + part.contact_tolerance_um + force_mN / softest
    high_um = pressed_um + rig.model.compliance_um_per_mN * force_mN
    return (
        max(-BELOW_REST * high_um, rig.limits.position_min_um),
        min(high_um, rig.limits.position_max_um),
    )
