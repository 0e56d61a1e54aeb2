"""What a job's columns say of a step of the position that the voltage does not explain; pure.

The controller reports the step, the force just before it, F, and just after it, F'. If the part
gave way by δ, F' is the force and δ = r + (F - F')/K_e; if the sensor jumped by r, the force is F
still and the free arm reads F' - F afterwards. So the force that is read on the way back decides,
as far as its uncertainty allows.
"""

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np

from pincette.api.results import PositionStep, StepCause
from pincette.config import RigFile
from pincette.control.force.ring_after_step import RESTED, ring_samples, rings
from pincette.core.faults import Outcome, Phase
from pincette.records.columns import Columns
from pincette_supervisor.plugin import sample_figures
from pincette_supervisor.plugin.sample_figures import series

RETURN_SAMPLES = 10
"""Samples at the end of the way back whose mean force decides."""


def position_step_of(table: Columns) -> PositionStep | None:
    """Return the step that a job has found; None without one."""
    steps_um = table["step_um"]
    row = next((place for place, step_um in enumerate(steps_um) if step_um is not None), None)
    if row is None:
        return None
    step_um, x_um, before_mN, after_mN = (
        float(sample_figures.last(table[name]) or 0.0)
        for name in ("step_um", "step_x_um", "step_mN", "step_after_mN")
    )
    stiffness, slips = table["contact_stiffness_mN_per_um"][row], _newest(table["slips"]) or 0
    source = _source(table, step_um, before_mN - after_mN)
    slip_um = None
    if source != "sensor" and stiffness:
        slip_um = step_um + (before_mN - after_mN) / stiffness
    return PositionStep(
        cause=source,
        at_s=table["t_s"][row],
        x_um=x_um,
        step_um=step_um,
        slip_um=slip_um,
        slips=slips,
        force_mN=before_mN,
        force_if_slip_mN=None if source == "sensor" else after_mN,
        force_if_sensor_mN=None if source == "slip" else before_mN,
    )


def with_ring(found: PositionStep, table: Columns, rig: RigFile) -> PositionStep:
    """Add whether the arm rang after the step; it is known where the voltage was kept then."""
    model = rig.model
    row = next(place for place, step_um in enumerate(table["step_um"]) if step_um is not None)
    first = max(0, row - 1)  # the step was confirmed by the sample after it
    stiffness = table["contact_stiffness_mN_per_um"][row] or rig.part.stiffness_mN_per_um
    kappa = model.compliance_um_per_mN * stiffness
    decay_per_s = model.damping_ratio * model.natural_frequency_rad_per_s
    rows = slice(first, first + ring_samples(decay_per_s, rig.rig.period_s) + RESTED)
    x_um, voltage_V, seq = (series(table, name)[rows] for name in ("x_um", "voltage_V", "seq"))
    if np.ptp(voltage_V[1:]) > 0.0 or (np.diff(seq) != 1.0).any():
        return found
    rang = rings(
        x_um,
        mode_rad_per_s=model.natural_frequency_rad_per_s * sqrt(1.0 + kappa),
        decay_per_s=decay_per_s,
        period_s=rig.rig.period_s,
        noise_um=rig.sensor.noise_um,
    )
    return found.model_copy(update={"rang": rang})


def _source(table: Columns, step_um: float, lost_mN: float) -> StepCause:
    if Outcome.SENSOR_JUMP in table["outcome"] or step_um < 0.0:
        return "sensor"
    returned = [
        (force_mN, uncertainty_mN)
        for phase, held, force_mN, uncertainty_mN in zip(
            *(table[name] for name in ("phase", "held", "force_mN", "force_uncertainty_mN")),
            strict=True,
        )
        if phase == Phase.RETREAT and not held and None not in (force_mN, uncertainty_mN)
    ][-RETURN_SAMPLES:]
    if not returned:
        return "unknown"
    read_mN = sum(force_mN for force_mN, _ in returned) / len(returned)
    # Half way between the readings of a free arm: 0 after a slip, -lost_mN after a jump.
    off_mN, doubt_mN = read_mN + 0.5 * lost_mN, returned[-1][1]
    if abs(off_mN) <= doubt_mN:
        return "unknown"
    return "slip" if off_mN > 0.0 else "sensor"


def _newest(values: Sequence[Any]) -> Any:
    return next((value for value in reversed(values) if value is not None), None)
