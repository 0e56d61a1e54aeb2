"""Open-loop motion that identifies the free response, the gain, the hysteresis loop and the creep.

All voltages are planned; no law is used. The program plays, in this order: the moves of
``teaching``; presses without a part; cycles of 2 V peak to peak at 0.5 Hz, the largest amplitude in
the paper, until they have settled; a step and a rest; rehearsed grips without a part, which show
the error of the model in a grip. The part must be removed before, so that the arm stays free.
"""

from collections.abc import Callable, Sequence
from math import isfinite, pi

from pincette.control.checks import require_positive
from pincette.control.planning.calibration_programs import (
    free_program,
    require_voltage,
    require_within,
)
from pincette.control.planning.conditioning import REST_S, stroke_depth_V, stroke_stops
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.path_shapes import sinusoid, voltage_moves
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Follow
from pincette.control.planning.teaching import COURSE, SLOW, Leg
from pincette.control.response.branch_fit import ConditionedWay
from pincette.control.response.conditioned_branch import strokes_needed
from pincette.control.response.model_errors import RehearsedGrip

GAIN_PP_V, GAIN_HZ = 2.0, 0.5
"""Peak-to-peak voltage in V, and frequency in Hz, for which d_p is reported: section VI.B of the
paper."""
SETTLING_CYCLES, GAIN_CYCLES = 3, 5
"""Number of cycles before the measured ones, and number of measured cycles."""
PRESS_LOW, PRESS_HIGH = 0.51, 0.96
"""Range of the presses, as fractions of the range of a grip. The error of the model is determined
in this range."""
PRESS_CYCLES = 4
"""Number of measured cycles of the presses, after the settling ones."""
CREEP_BEFORE_S, CREEP_S = 6.0, 12.0
"""Rests before and after the step, in s. The first is long, so that the remaining creep is slow."""
REHEARSED = ((0.50, 0.62), (0.55, 0.88), (0.60, 0.75), (0.52, 0.95), (0.57, 0.70), (0.50, 0.82))
"""Voltage at the contact and at the end of the press of each rehearsed grip, as fractions of the
range of a grip."""
BEFORE_S, ZERO_S, HELD_S = 0.4, 0.4, 5.0
"""Rests of a rehearsal, in s: before and after it, at the zero, and while pressing."""
CONDITIONED = ((0.50, 0.95), (0.57, 0.82), (0.30, 0.60), (0.52, 0.70))
"""Voltage at the contact and at the end of the press of each rehearsed grip that begins with
conditioning strokes, as fractions of the range of a grip."""
CONDITIONED_HELD_S = 2.0
BEYOND = 0.01
"""Overshoot of the approach in a rehearsal, as a fraction of the range. In a real grip, creep at
the zero makes the law move the voltage back by about this much, and Bouc-Wen hysteresis retains a
memory of this reversal."""
STAIRCASES = 2
STAIRS, STAIR_S = 16, 0.25
"""Number of rests on the rising branch after conditioning strokes, and duration of each rest in
s."""
SWINGS_EVERY = 3
"""Every rehearsal whose number is a multiple of this continues its hold with small swings, like
those that noise and a law cause."""
SMALL_PP_V, SMALL_HZ, SMALL_S = 0.02, 12.5, 4.0
"""Peak-to-peak voltage, frequency and duration of the small swings: a total voltage travel of 1 V,
as in a hold of about 30 s. Their width is little above that of noise, since relays respond
according to the width."""
SMALL_SAMPLES = 4.0
"""Smallest number of samples in a period of the small swings."""


def free_response_program(
    rig: PlannedRig,
    *,
    from_V: float,
    to_V: float,
    rate_V_per_s: float,
    rest_V: float = 0.0,
    grip_V_per_s: float | None = None,
    lowest_V: float | None = None,
) -> Program:
    """Return the program of the free motion.

    Its phases are ``teach``, ``before presses``, ``presses``, ``after presses``, ``cycles``,
    ``before step``, ``step``, ``creep`` and ``return``. Rehearsal N, from 1 on, has ``approach N``,
    ``press N``, ``let go N`` and sometimes ``small swings N``. Where strokes are possible,
    conditioned motion N has ``strokes N``, then ``stairs N`` or both ``conditioned approach N`` and
    ``conditioned press N``, and ``go back N``.

    Parameters
    ----------
    from_V, to_V
        Range of voltages that a grip needs.
    rate_V_per_s
        Peak rate of the fastest moves of the course.
    grip_V_per_s
        Peak rate of the rehearsed grips; None: that of the course.
    rest_V
        Voltage at which the program begins and ends.
    lowest_V
        Lowest voltage of the course; None: ``from_V``. Conditioning strokes reach at most the
        lowest voltage of the course, since the model is not known below it.

    Raises
    ------
    ValueError
        If the range, including ``rest_V``, or the rate exceeds a limit of the rig (for the
        position, by the nominal gain), or the voltage range is narrower than the 2 V of the cycles.
    """
    if not (isfinite(from_V) and isfinite(to_V)):
        raise ValueError(f"voltages from {from_V} V to {to_V} V, must be finite")
    require_positive("range of the free motion", to_V - from_V, "V")
    require_positive("rate of the free motion", rate_V_per_s, "V/s")
    mean_V = cycles_mean_V(rig, rest_V)
    low_V = min(from_V, mean_V - 0.5 * GAIN_PP_V)
    high_V = max(to_V, mean_V + 0.5 * GAIN_PP_V)
    for voltage_V in (rest_V, min(low_V, lowest_V or low_V), high_V):
        require_voltage(rig, "free motion", voltage_V)
        require_within(
            f"position at {voltage_V:g} V",
            rig.x_start_um + rig.piezo_um_per_V * (voltage_V - rest_V),
            "µm",
            rig.limits.position_min_um,
            rig.limits.position_max_um,
        )
    fastest = max(rate_V_per_s, pi * GAIN_PP_V * GAIN_HZ)
    require_within("rate of the free motion", fastest, "V/s", 0.0, rig.limits.slew_V_per_s)
    way_V = to_V - from_V
    least_V = from_V if lowest_V is None else min(lowest_V, from_V)
    course_V = to_V - least_V
    course = [
        (least_V + leg.to * course_V, leg.pace * rate_V_per_s, leg.rest_s)
        for leg in slow_on_new_ground(COURSE)
    ]
    teach = voltage_moves([(rest_V, rate_V_per_s, 0.0), *course, (mean_V, rate_V_per_s, 0.0)])
    cycles = sinusoid("voltage", mean_V, GAIN_PP_V, GAIN_HZ, SETTLING_CYCLES + GAIN_CYCLES)
    press_V = from_V + 0.5 * (PRESS_LOW + PRESS_HIGH) * way_V
    # The voltage is reached from above, as after the first press on a part.
    crest_V = from_V + PRESS_HIGH * way_V
    lead = voltage_moves(
        [(mean_V, rate_V_per_s, 0.0), (crest_V, rate_V_per_s, 0.5), (press_V, rate_V_per_s, 0.5)]
    )
    press_pp_V = (PRESS_HIGH - PRESS_LOW) * way_V
    presses = sinusoid("voltage", press_V, press_pp_V, GAIN_HZ, SETTLING_CYCLES + PRESS_CYCLES)
    fastest = max(fastest, 2.0 * pi * GAIN_HZ * presses.amplitude)
    require_within("rate of the free motion", fastest, "V/s", 0.0, rig.limits.slew_V_per_s)
    follow = voltage_moves([(press_V, rate_V_per_s, 0.0), (mean_V, rate_V_per_s, 0.5)])
    before = voltage_moves([(mean_V, rate_V_per_s, 0.0), (from_V, rate_V_per_s, CREEP_BEFORE_S)])
    # The step is as fast as possible, since the time of the creep counts from its middle.
    step = voltage_moves([(from_V, 0.0, 0.0), (to_V, rig.limits.slew_V_per_s, 0.0)])
    back = voltage_moves([(to_V, rate_V_per_s, 0.0), (rest_V, rate_V_per_s, 0.5)])
    quick_V_per_s = grip_V_per_s or rate_V_per_s
    require_within("rate of the grips", quick_V_per_s, "V/s", 0.0, rig.limits.slew_V_per_s)
    grips = [(from_V + contact * way_V, from_V + pressed * way_V) for contact, pressed in REHEARSED]
    low_V = stroke_depth_V((least_V, to_V), rig.limits.voltage_min_V)
    conditioned: list[Drive] = []
    if low_V is not None:
        conditioned = _conditioned(rig, (low_V, rest_V, from_V, to_V), quick_V_per_s)
    return free_program(
        Drive("teach", teach.duration_s, courses=(Follow(teach),)),
        Drive("before presses", lead.duration_s, courses=(Follow(lead),)),
        Drive("presses", presses.duration_s, courses=(Follow(presses),)),
        Drive("after presses", follow.duration_s, courses=(Follow(follow),)),
        Drive("cycles", cycles.duration_s, courses=(Follow(cycles),)),
        Drive("before step", before.duration_s, courses=(Follow(before),)),
        Drive("step", step.duration_s, courses=(Follow(step),)),
        Drive("creep", CREEP_S),
        Drive("return", back.duration_s, courses=(Follow(back),)),
        *[
            segment
            for number, grip_V in enumerate(grips, start=1)
            for segment in _rehearsal(rig, number, (rest_V, *grip_V), quick_V_per_s)
        ],
        *conditioned,
    )


def slow_on_new_ground(course: Sequence[Leg]) -> list[Leg]:
    """Return a course whose moves beyond all earlier positions are slow: a part may be there."""
    found, highest = list[Leg](), 0.0
    for leg in course:
        found.append(leg._replace(pace=min(leg.pace, SLOW)) if leg.to > highest else leg)
        highest = max(highest, leg.to)
    return found


def _conditioned(
    rig: PlannedRig, voltages_V: tuple[float, float, float, float], rate_V_per_s: float
) -> list[Drive]:
    """Return motions that begin with conditioning strokes: staircases, then rehearsed grips."""
    low_V, rest_V, from_V, to_V = voltages_V
    way_V, count = to_V - from_V, strokes_needed(low_V, to_V)
    stairs = [(step / STAIRS * to_V, rate_V_per_s, STAIR_S) for step in range(1, STAIRS + 1)]
    ways = [[("stairs", stairs)] for _ in range(STAIRCASES)]
    for contact, pressed in CONDITIONED:
        contact_V, press_V = from_V + contact * way_V, from_V + pressed * way_V
        beyond_V = contact_V + BEYOND * way_V
        ways.append(
            [
                (
                    "conditioned approach",
                    [(beyond_V, rate_V_per_s, 0.0), (contact_V, rate_V_per_s, ZERO_S)],
                ),
                ("conditioned press", [(press_V, rate_V_per_s, CONDITIONED_HELD_S)]),
            ]
        )
    begins_V, segments = rest_V, list[Drive]()
    for number, parts in enumerate(ways, start=1):
        first, *stops = stroke_stops(low_V, rig.limits.slew_V_per_s, count)
        *stops, last = stops
        start = [] if begins_V == first[0] else [(begins_V, rate_V_per_s, 0.0)]
        named = [("strokes", [*start, first, *stops, (last[0], last[1], REST_S)])]
        at_V = last[0]
        for what, moves in parts:
            begin_s = BEFORE_S if what == "conditioned approach" else 0.0
            named.append((what, [(at_V, rate_V_per_s, begin_s), *moves]))
            at_V = moves[-1][0]
        named.append(("go back", [(at_V, rate_V_per_s, 0.0), (rest_V, rate_V_per_s, BEFORE_S)]))
        begins_V = rest_V
        for what, moves in named:
            path = voltage_moves(moves)
            segments.append(Drive(f"{what} {number}", path.duration_s, courses=(Follow(path),)))
    return segments


def conditioned_ways(
    samples_of: Callable[[str], slice], program: Program
) -> tuple[ConditionedWay, ...]:
    """Return the samples of a program's conditioned motions; empty if it has none."""
    phases = {segment.phase for segment in program.segments}
    found: list[ConditionedWay] = []
    for number in range(1, STAIRCASES + len(CONDITIONED) + 1):
        if f"strokes {number}" not in phases:
            break
        strokes = samples_of(f"strokes {number}")
        if number <= STAIRCASES:
            found.append(ConditionedWay(strokes, samples_of(f"stairs {number}"), None))
        else:
            grip = RehearsedGrip(
                samples_of(f"conditioned approach {number}"),
                samples_of(f"conditioned press {number}"),
                let_go=samples_of(f"go back {number}"),
            )
            found.append(ConditionedWay(strokes, None, grip))
    return tuple(found)


def _rehearsal(
    rig: PlannedRig, number: int, voltages_V: tuple[float, float, float], rate_V_per_s: float
) -> list[Drive]:
    """Return a grip without a part: from the rest to the contact, the press, and back."""
    rest_V, contact_V, press_V = voltages_V
    approach = voltage_moves([(rest_V, 0.0, BEFORE_S), (contact_V, rate_V_per_s, ZERO_S)])
    press = voltage_moves([(contact_V, 0.0, 0.0), (press_V, rate_V_per_s, HELD_S)])
    let_go = voltage_moves([(press_V, 0.0, 0.0), (rest_V, rate_V_per_s, BEFORE_S)])
    paths = [("approach", approach), ("press", press), ("let go", let_go)]
    if number % SWINGS_EVERY == 0:
        paths.insert(2, ("small swings", _small_swings(rig, press_V)))
    return [
        Drive(f"{what} {number}", path.duration_s, courses=(Follow(path),)) for what, path in paths
    ]


def rehearsed_grips(
    samples_of: Callable[[str], slice], program: Program
) -> tuple[RehearsedGrip, ...]:
    """Return the samples of the rehearsals of a free-response program, one slice per phase."""
    phases = {segment.phase for segment in program.segments}
    return tuple(
        RehearsedGrip(
            samples_of(f"approach {number}"),
            samples_of(f"press {number}"),
            samples_of(f"small swings {number}") if f"small swings {number}" in phases else None,
            samples_of(f"let go {number}"),
        )
        for number in range(1, len(REHEARSED) + 1)
    )


def _small_swings(rig: PlannedRig, mean_V: float) -> Path:
    """Return small swings about a voltage, or about the nearest voltage that the limits allow."""
    limits, half_V = rig.limits, 0.5 * SMALL_PP_V
    about_V = min(max(mean_V, limits.voltage_min_V + half_V), limits.voltage_max_V - half_V)
    hz = min(SMALL_HZ, 1.0 / (SMALL_SAMPLES * rig.period_s))
    return sinusoid("voltage", about_V, SMALL_PP_V, hz, max(1, round(SMALL_S * hz)))


def cycles_mean_V(rig: PlannedRig, rest_V: float = 0.0) -> float:
    """Return the mean of the cycles: the rest voltage if the limits leave 1 V on both sides.

    Otherwise it is the nearest mean that the limits of voltage, and of position by nominal gain,
    allow.

    Raises
    ------
    ValueError
        If the limits allow no mean.
    """
    limits, d_p = rig.limits, require_positive("gain", rig.piezo_um_per_V, "µm/V")
    lowest_V = max(limits.voltage_min_V, rest_V + (limits.position_min_um - rig.x_start_um) / d_p)
    highest_V = min(limits.voltage_max_V, rest_V + (limits.position_max_um - rig.x_start_um) / d_p)
    if highest_V - lowest_V < GAIN_PP_V:
        raise ValueError(
            f"cycles of {GAIN_PP_V:g} V peak to peak, limits {lowest_V:.3f} V to {highest_V:.3f} V"
        )
    return min(max(rest_V, lowest_V + 0.5 * GAIN_PP_V), highest_V - 0.5 * GAIN_PP_V)
