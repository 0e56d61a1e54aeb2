"""Motion of a data sheet: sections of the free arm and of the pressed part, each with its name.

Short grips come between both.

The evaluation finds the samples of a section by the numbers of the section's segments. The motion
of the free arm is limited by the position of the part, and by shares of the rig's slew limit.
"""

from dataclasses import dataclass
from math import ceil, pi

from pincette.config import RigFile
from pincette.config.derived import X_START_UM
from pincette.control.calibration.characteristics import cycle_lengths
from pincette.control.planning.conditioning import PHASE
from pincette.control.planning.contact_request import MARGIN_UM, ContactRequest
from pincette.control.planning.path_shapes import sinusoid, voltage_moves
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.segments import (
    Drive,
    Follow,
    Move,
    Press,
    Ramp,
    Rest,
    Segment,
    Stay,
    Track,
)

GAIN_GROWTH = 1.3
"""Largest ratio of the gain over the free stroke to d_p: hysteresis increases the gain of long
strokes."""
BRANCH_S = 4.0
"""Duration of each branch of a loop, in s."""
CREEP_S = 10.0
CREEP_SHARE = 0.75
"""Height of the step after which creep is measured, as a fraction of the free stroke."""
JUMP_S = 0.5
"""Duration of the step before creep, in s."""
LOWEST_HZ = 0.5
SWING_UM = 1.0
"""Largest amplitude of the small signals of the free arm, in µm."""
FORCE_SHARE = 0.05
"""Amplitude of the small signals of the force, as a fraction of the highest force."""
SLEW_SHARE = 0.3
"""Fraction of the slew limit that small signals use."""
MODE_SHARE = 0.125
"""Highest frequency as a fraction of the mode's frequency; higher ones would excite the mode."""
MOVE_SAMPLES, TRACK_SAMPLES = 4, 10
"""Smallest number of samples in a cycle: of the free arm, and of the force."""
CYCLES, CYCLES_S = 4, 0.5
"""Smallest number of cycles at each frequency, and their shortest total duration, in s.

The first cycle is not evaluated.
"""
SHORT_HOLD_S = 1.0
"""Duration of the hold of each grip but the last, in s."""
STEPS, STEP_S = 2, 1.5
"""Number of steps up and of steps down, and the duration of each, in s."""
HOLD_S = 5.0
QUINTIC_PEAK = 1.875
"""Ratio of the peak to the mean speed of a quintic move."""

Named = list[tuple[str, Segment]]
"""Segments in order, each with the name of its section; the name is empty if nothing is
measured."""


@dataclass(frozen=True, slots=True)
class Sections:
    """Segments of a data sheet in two parts, and the levels at which they measure."""

    free: Named
    pressed: Named
    free_V: float
    """Highest voltage of the free stroke, in V."""
    at_um: float
    """Position around which the free arm oscillates, in µm."""
    swing_um: float
    """Amplitude of the free arm's oscillations, in µm."""
    at_mN: float
    """Force around which the force oscillates, in mN."""
    swing_mN: float
    """Amplitude of the force, in mN."""
    step_s: float
    """Duration of a step of the reference, in s."""

    def numbers(self, section: str, segments: int) -> list[int]:
        """Return the numbers of a section's segments in a program with this many segments."""
        # After the pressed part, only the retreat follows.
        first = segments - 1 - len(self.pressed)
        free = [place for place, (name, _) in enumerate(self.free) if name == section]
        pressed = [first + place for place, (name, _) in enumerate(self.pressed) if name == section]
        return free + pressed


def sections(
    rig: RigFile, contact: ContactRequest, force_mN: float, noise_s: float, begin_um: float
) -> Sections:
    """Return the sections of a data sheet.

    Parameters
    ----------
    rig
        Rig with the model in use.
    begin_um
        Position of the arm at the beginning of the job, in µm.

    Raises
    ------
    ValueError
        If the part leaves no room for free motion.
    """
    period_s, d_p = rig.rig.period_s, rig.model.piezo_um_per_V
    slew_um_per_s = SLEW_SHARE * rig.limits.slew_V_per_s * d_p
    room_um = contact.stand_off_um - MARGIN_UM - X_START_UM
    swing_um = min(SWING_UM, 0.1 * room_um)
    if room_um <= 2.0 * MARGIN_UM:
        raise ValueError(
            f"the part leaves {room_um:.3g} µm of free motion, but a data sheet needs more than "
            f"{2.0 * MARGIN_UM:g} µm: place the part further away"
        )
    free_V = room_um / (GAIN_GROWTH * d_p)
    at_mN, swing_mN = 0.5 * force_mN, FORCE_SHARE * force_mN
    # A force F shifts the free displacement by s_p·F + F/K_e.
    yields = rig.model.compliance_um_per_mN + 1.0 / contact.stiffness_mN_per_um
    largest_um = max(swing_um, 2.0 * swing_mN * yields)
    step_s = period_s * max(1, ceil(QUINTIC_PEAK * largest_um / slew_um_per_s / period_s))
    highest_hz = MODE_SHARE * rig.model.natural_frequency_rad_per_s / (2.0 * pi)
    free = _free(
        begin_um=begin_um,
        free_V=free_V,
        to_um=X_START_UM + room_um / GAIN_GROWTH,
        approach_um_per_s=contact.approach_um_per_s,
        swing_um=swing_um,
        slew_um_per_s=slew_um_per_s,
        highest_hz=highest_hz,
        noise_s=noise_s,
        period_s=period_s,
        step_s=step_s,
    )
    pressed: Named = [
        ("", Press("load", contact.load_s, to_mN=force_mN)),
        ("held full", Press("hold", HOLD_S, to_mN=force_mN)),
        ("", Press("settle", STEP_S + contact.load_s, to_mN=at_mN, move_s=contact.load_s)),
        ("force noise", Press("settle", noise_s)),
    ]
    for length in cycle_lengths(LOWEST_HZ, highest_hz, TRACK_SAMPLES, period_s):
        frequency_hz = 1.0 / (length * period_s)
        path = sinusoid("force", at_mN, 2.0 * swing_mN, frequency_hz, _cycles(length * period_s))
        pressed.append(("force sweep", Track("track", path.duration_s, force=path)))
    for to_mN in STEPS * (at_mN + 2.0 * swing_mN, at_mN):
        name = "force step" if to_mN > at_mN else ""
        pressed.append((name, Press("settle", STEP_S, to_mN=to_mN, move_s=step_s)))
    quarter = Press("settle", HOLD_S + contact.load_s, to_mN=0.5 * at_mN, move_s=contact.load_s)
    pressed += [("held quarter", quarter), ("", Press("unload", contact.load_s, to_mN=0.0))]
    at_um = X_START_UM + 0.5 * room_um / GAIN_GROWTH
    return Sections(free, pressed, free_V, at_um, swing_um, at_mN, swing_mN, step_s)


def short_grip(contact: ContactRequest, force_mN: float) -> list[Segment]:
    """Return the segments from load to unload of a grip that measures the zero return alone."""
    return [
        Press("load", contact.load_s, to_mN=force_mN),
        # A hold would be taken for that of the job.
        Press("settle", SHORT_HOLD_S),
        Press("unload", contact.load_s, to_mN=0.0),
    ]


def _free(
    *,
    begin_um: float,
    free_V: float,
    to_um: float,
    approach_um_per_s: float,
    swing_um: float,
    slew_um_per_s: float,
    highest_hz: float,
    noise_s: float,
    period_s: float,
    step_s: float,
) -> Named:
    """Return the sections of the free arm, which may begin anywhere and end at their start."""
    rate = QUINTIC_PEAK * free_V / BRANCH_S
    loop = voltage_moves([(0.0, rate, 0.0), *(2 * [(free_V, rate, 0.0), (0.0, rate, 0.0)])])
    begin_V = CREEP_SHARE * free_V
    at_um = 0.5 * (X_START_UM + to_um)
    creep_um = X_START_UM + CREEP_SHARE * (to_um - X_START_UM)
    home_s = move_duration(begin_um - X_START_UM, approach_um_per_s)
    back_s = move_duration(to_um - X_START_UM, approach_um_per_s)

    def drive(name: str, course: Stay | Ramp | Follow, duration_s: float) -> tuple[str, Segment]:
        # These strokes do not end the program: they have the phase name of strokes before an
        # approach.
        return name, Drive(PHASE, duration_s, guarded=True, courses=(course,))

    def move(name: str, phase: str, goal_um: float, duration_s: float) -> tuple[str, Segment]:
        return name, Move(phase, duration_s, to_um=(goal_um,))

    def rest(name: str, phase: str, duration_s: float) -> tuple[str, Segment]:
        return name, Rest(phase, duration_s, zeroes=False)

    made: Named = [
        move("", "open", X_START_UM, home_s),
        drive("", Ramp(0.0), JUMP_S),
        drive("open loop", Follow(loop), loop.duration_s),
        drive("", Ramp(begin_V), JUMP_S),
        drive("open creep", Stay(), CREEP_S),
        drive("", Ramp(0.0), BRANCH_S),
        ("", Rest("zero", 1.0, guarded=True)),
    ]
    for goal_um in 2 * (to_um, X_START_UM):
        name, segment = move("closed loop", "follow", goal_um, BRANCH_S)
        made.append((name, segment))
    made += [
        move("", "creep", creep_um, JUMP_S),
        rest("closed creep", "creep", CREEP_S),
        move("", "noise", at_um, back_s),
        rest("", "noise", 1.0),
        rest("position noise", "noise", noise_s),
    ]
    for length in cycle_lengths(LOWEST_HZ, highest_hz, MOVE_SAMPLES, period_s):
        half_s = 0.5 * length * period_s
        size_um = min(swing_um, slew_um_per_s * half_s / (2.0 * QUINTIC_PEAK))
        for cycle in range(_cycles(length * period_s)):
            name = "sweep" if cycle else ""
            made.append(move(name, "sweep", at_um + size_um, half_s))
            made.append(move(name, "sweep", at_um - size_um, half_s))
    made += [move("", "step", at_um, 0.2 * STEP_S), rest("", "step", STEP_S)]
    for goal_um in STEPS * (at_um + swing_um, at_um):
        name = "position step" if goal_um > at_um else ""
        made += [move(name, "step", goal_um, step_s), rest(name, "step", STEP_S)]
    made.append(move("", "open", X_START_UM, back_s))
    return made


def _cycles(cycle_s: float) -> int:
    return max(CYCLES, ceil(CYCLES_S / cycle_s))
