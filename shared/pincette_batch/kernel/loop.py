"""The loop of one lane: sensor, estimator, controller and actuator, and the plant between them.

Ticks go in the order of the composed loop. A zero is left to the estimator itself: the lane comes
back with ``Ending.ZERO``, and goes on when it has the answer.
"""

from typing import Any

from pincette.control.laws.force_input import ForceInput
from pincette.control.laws.sliding import LawOutput
from pincette.control.planning.contact_line import ContactLine
from pincette.control.response.play_operators import Plays, voltage_for
from pincette.control.safety.voltage import limited
from pincette_batch.kernel.constants import Bench, Floats, Inverse, Observer, Play, Rows
from pincette_batch.kernel.estimator import follow, force_mN, stuck
from pincette_batch.kernel.instruments import arm_um, put_out_V, reading_um
from pincette_batch.kernel.lane import (
    APPLIED,
    BAND,
    FORCE,
    FORCE_R,
    PERTURBATION_ERROR,
    RESIDUAL,
    SEGMENT,
    SLIDING,
    STIFFNESS,
    TRUE_FORCE,
    TRUE_X,
    VOLTAGE,
    X_D,
    X_R,
    Ending,
    LaneRecord,
    X,
)
from pincette_batch.kernel.law import command, rebase, seen_V, start_at
from pincette_batch.kernel.plant import Moved, pass_tick, true_force_mN
from pincette_batch.kernel.player import advance

DONE, ZERO, LIMIT = int(Ending.DONE), int(Ending.ZERO), int(Ending.LIMIT)
BLIND, ABSURD, TOO_LONG = int(Ending.BLIND), int(Ending.ABSURD), int(Ending.TOO_LONG)


def play(
    bench: Bench,
    observer: Observer,
    k: Play,
    parameters: Any,
    source: ForceInput,
    inverse: Inverse,
    lane: LaneRecord,
    moved: Moved,
    law: Any,
    line: ContactLine,
    plays_V: Floats,
    creep_um: Floats,
    noise: Rows,
    drift_um: Rows,
    columns: Floats,
    displacements_um: Floats,
    scratch: Rows,
) -> tuple[Moved, Any, ContactLine]:
    """Tick until ``lane.ending`` is set.

    Parameters
    ----------
    noise, drift_um
        Of the sensor: standard normal, and in µm, one a tick.
    columns
        Shape (columns, ticks); filled, see ``lane.COLUMNS``.
    displacements_um
        Of the free response's model, one a tick; filled.
    scratch
        Shape (2, substeps), of the longest stretch.
    """
    while lane.ending == 0:
        if not lane.sensed:
            sense(bench, observer, lane, moved, noise, drift_um, columns)
            if lane.ending == 0:
                displacement_um = follow(observer, lane, plays_V, creep_um, lane.voltage_V)
                displacements_um[lane.tick] = displacement_um
                estimate(observer, lane, displacement_um)
        if lane.ending == 0:
            displacement_um = float(displacements_um[lane.tick])
            if not lane.steered:
                law = start_at(parameters, lane, seen_V(inverse, lane, displacement_um))
            law, line = control(
                k,
                observer.model,
                parameters,
                source,
                inverse,
                lane,
                law,
                line,
                plays_V,
                creep_um,
                displacement_um,
                columns,
            )
        if lane.ending == 0:
            moved = pass_tick(bench, moved, put_out_V(bench, lane.voltage_V), scratch)
            lane.tick += 1
            lane.sensed, lane.steered = False, True
            if lane.ended:
                lane.ending = DONE
    return moved, law, line


def sense(
    bench: Bench,
    observer: Observer,
    lane: LaneRecord,
    moved: Moved,
    noise: Rows,
    drift_um: Rows,
    columns: Floats,
) -> None:
    """Measure, unless there is nothing to be had from it, or the estimator must answer."""
    tick = lane.tick
    if tick >= columns.shape[1]:
        lane.ending = TOO_LONG
        return
    shown_um = reading_um(bench, moved.x_um, drift_um[tick], noise[tick])
    x_um = arm_um(bench, shown_um)
    columns[X, tick], columns[APPLIED, tick] = x_um, lane.voltage_V
    columns[TRUE_X, tick], columns[TRUE_FORCE, tick] = moved.x_um, true_force_mN(bench, moved)
    measured = bench.minimum_um <= shown_um <= bench.maximum_um
    if not measured or stuck(observer, lane, columns, x_um):
        lane.ending = BLIND
        return
    lane.x_um, lane.sensed = x_um, True
    if lane.zero:
        lane.ending = ZERO


def estimate(observer: Observer, lane: LaneRecord, displacement_um: float) -> None:
    """The force of the sample; with the first one x_1 begins."""
    if lane.tick == 0:
        lane.offset_um = lane.x_um - displacement_um
        lane.x_r_um = lane.from_x_um = lane.x_um
    lane.force_mN = force_mN(observer, lane, displacement_um)


def control(
    k: Play,
    model: Plays,
    parameters: Any,
    source: ForceInput,
    inverse: Inverse,
    lane: LaneRecord,
    law: Any,
    line: ContactLine,
    plays_V: Floats,
    creep_um: Floats,
    displacement_um: float,
    columns: Floats,
) -> tuple[Any, ContactLine]:
    """Controller and actuator: from the estimate to the voltage that is put out.

    The controller's memory of the free response is the estimator's: both are led by what is
    applied.
    """
    tick, pressed = lane.tick, lane.pressing
    columns[FORCE, tick] = lane.force_mN
    columns[X_R, tick], columns[FORCE_R, tick] = lane.x_r_um, lane.force_r_mN
    line = advance(k, lane, line)
    if lane.ending != 0:
        return law, line
    force, force_r = (lane.force_mN, lane.force_r_mN) if lane.pressing else (0.0, 0.0)
    if lane.bump or lane.pressing != pressed:
        law = rebase(parameters, lane, law, lane.x_r_um, force, force_r)
    aim_um = lane.x_d_um
    seen = seen_V(inverse, lane, displacement_um)
    law, output = command(parameters, source, lane, law, seen, force, force_r)
    law_V = output.voltage_V
    if inverse.inverts:
        law_V = voltage_for(
            model,
            plays_V,
            creep_um,
            lane.static_um,
            lane.voltage_V,
            inverse.um_per_V * law_V,
            inverse.um_per_V,
        )
    lane.x_d_um = output.x_d_um
    write_columns(lane, aim_um, output, columns)
    wanted_V = lane.voltage_V if lane.ended else law_V
    if not k.least_V <= wanted_V <= k.most_V:
        lane.ending = ABSURD
    elif beyond_limits(k, lane, aim_um):
        lane.ending = LIMIT
    else:
        lane.voltage_V, lane.limits_active = limited(k.voltage, lane.voltage_V, wanted_V)
        columns[VOLTAGE, tick] = lane.voltage_V
    return law, line


def write_columns(lane: LaneRecord, aim_um: float, output: LawOutput, columns: Floats) -> None:
    """How the controller sees the sample."""
    tick = lane.tick
    columns[X_D, tick], columns[SLIDING, tick] = aim_um, output.sliding_um
    columns[BAND, tick], columns[RESIDUAL, tick] = output.band_um, output.residual_um
    columns[PERTURBATION_ERROR, tick] = output.perturbation_error_mN
    columns[SEGMENT, tick], columns[STIFFNESS, tick] = lane.index, lane.stiffness_mN_per_um


def beyond_limits(k: Play, lane: LaneRecord, aim_um: float) -> bool:
    """Whether a hard limit acts, as ``monitors`` count: in a row, and leakily what follows."""
    m = k.monitors
    if lane.zeroed:
        lane.force_over = lane.force_over + 1 if lane.force_mN > m.force_mN else 0
    if lane.steered and not lane.ended:
        way_um = abs(aim_um - lane.aim_um) if lane.aimed else 0.0
        bound_um = m.following_um + m.following_s * (way_um / m.period_s)
        off = abs(lane.x_um - aim_um) > bound_um
        leaked = max(0, lane.following_over - 1)
        lane.following_over = lane.following_over + 1 if off else leaked
        lane.aim_um, lane.aimed = aim_um, True
    inside = m.position_min_um <= lane.x_um <= m.position_max_um
    lane.position_over = 0 if inside else lane.position_over + 1
    return (
        lane.force_over >= m.force_samples
        or lane.following_over >= m.following_samples
        or lane.position_over >= m.position_samples
    )
