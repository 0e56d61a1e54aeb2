"""Reaction of the controller to a step of the position that the voltage does not explain.

The first sample that shows the step freezes the voltage. The next one confirms it, or the program
continues. The meaning of a confirmed step depends on its direction and on the references:

    backwards                       ``sensor_jump``: no slip moves the arm back
    forwards, references move       ``slipped``: the part has yielded; the line restarts there
    forwards, references constant   ``position_step``: slip or sensor, not distinguishable here

After a slip during a load the program repeats the load, up to its limit. A held part whose force is
uncertain is not released: the voltage stays frozen until the hold ends.
"""

from msgspec.structs import replace

from pincette.control.force.position_steps import (
    AVERAGED,
    Kappa,
    StepLimits,
    StepWatch,
    unexplained_um,
)
from pincette.control.planning.contact_line import ContactFit, ContactLine
from pincette.control.planning.load_line import (
    LEAST_STIFFNESS,
    is_straight,
    stiffness_bounds,
    stiffness_error,
)
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Press, paths_of
from pincette.core.faults import KEPT, Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.player_state import (
    NO_PAUSE,
    Player,
    SeenStep,
    enter,
    has_phase,
    jump,
    with_line,
    with_slip,
)

CONFIRMING_SHARE = 0.3
"""Fraction of a step that the next sample must show to confirm it; oscillation of the mode may hide
the remainder.
"""
LINE_KNOWN, LINE_ERROR = 4, 0.1
"""Number of samples of a load, and largest relative standard error of its stiffness, from which
the fitted line is used to judge a step."""
LINE_AFTER_UM = 1.2
"""Distance that the arm moves under load, in µm, after which the fitted line is used to judge a
step."""
UNWATCHED = (Phase.UNLOAD, Phase.RETREAT, Phase.STOPPING)
"""Phases that end the contact: there the arm moves back intentionally."""


def admissible(program: Program, K_e: float) -> bool:
    """Return whether a contact stiffness may be used: within 0.3 to 3 times the planned one.

    A program that measures the stiffness itself specifies wider bounds, which apply instead.
    """
    least, most = stiffness_bounds(program.contact_stiffness_mN_per_um, program.guards)
    return least <= K_e <= most


def line_so_far(
    program: Program, player: Player, x_um: float, limits: StepLimits | None
) -> ContactFit | None:
    """Return the contact line of a load once it is long enough, admissible and straight."""
    line = player.line
    if not line.count or not abs(x_um - line.first_x_um) >= LINE_AFTER_UM:
        return None
    fit = line.fit()
    if fit is None or not admissible(program, fit.K_e_mN_per_um):
        return None
    if limits is None:
        return fit
    return fit if is_straight(fit, limits.noise_um, limits.compliance_um_per_mN) else None


def watch_steps(
    program: Program, player: Player, estimate: ArmEstimate, limits: StepLimits | None
) -> Player:
    """Judge the newest sample of a pressed part; a suspected step freezes the voltage for one
    tick.
    """
    along_path = bool(paths_of(player.segment))
    if limits is None or not _watched(program, player, estimate, along_path=along_path):
        if player.slip.suspect is None and not player.slip.steps.x_um:
            return player
        return with_slip(player, suspect=None, steps=StepWatch())
    x_um = estimate.x_um
    free_um = x_um + limits.compliance_um_per_mN * estimate.force_mN
    limits = limits.with_noise(player.slip.noise_um)
    kappa = _kappa(program, player, limits, x_um)
    if player.slip.suspect is not None:
        return _confirm(program, player, estimate, limits, free_um, kappa)
    watch = player.slip.steps.updated(limits, x_um, free_um)
    player = replace(player, slip=replace(player.slip, steps=watch))
    seen = player.slip.confirmed
    if seen is not None and player.segment.open_loop and seen.samples < AVERAGED:
        shown_um = unexplained_um(seen.step, x_um, free_um, kappa)
        return with_slip(player, confirmed=seen.averaged(shown_um, estimate.force_mN))
    step = watch.step(limits, kappa, along_path=along_path)
    return player if step is None else with_slip(player, suspect=step)


def _watched(program: Program, player: Player, estimate: ArmEstimate, *, along_path: bool) -> bool:
    """Return whether a part is pressed, so that the position follows from voltage and stiffness.

    A path is not watched while the force is below the contact force, since the arm may be free. Two
    arms are not watched: both voltages determine position and opening, and the difference of the
    two forces is monitored instead.
    """
    segment = player.segment
    if not player.held or segment.phase in UNWATCHED or player.felt is not None:
        return False
    if segment.lets_go:
        return False
    return not along_path or estimate.force_mN >= program.guards.contact_force_mN


def _kappa(program: Program, player: Player, limits: StepLimits, x_um: float) -> Kappa:
    """Return s_p·K_e of the part; in a load whose line is not known yet, the smallest possible
    value."""
    planned = program.contact_stiffness_mN_per_um
    if player.segment.phase != Phase.LOAD or program.contact_line != "identified":
        return Kappa(limits.kappa(_stiffness(program, player)))
    fit, line = line_so_far(program, player, x_um, limits), player.line
    if fit is not None and line.count >= LINE_KNOWN:
        s_p = limits.compliance_um_per_mN
        if stiffness_error(line, fit, limits.noise_um, s_p) <= LINE_ERROR:
            return Kappa(limits.kappa(fit.K_e_mN_per_um))
    return Kappa(limits.kappa(LEAST_STIFFNESS * planned), known=False)


def _confirm(
    program: Program,
    player: Player,
    estimate: ArmEstimate,
    limits: StepLimits,
    free_um: float,
    kappa: Kappa,
) -> Player:
    """Act on a suspected step that the newest sample still shows; otherwise discard the step."""
    step = player.slip.suspect
    assert step is not None
    shown_um = unexplained_um(step, estimate.x_um, free_um, kappa)
    watch = StepWatch().updated(limits, estimate.x_um, free_um)
    player = with_slip(player, suspect=None, steps=watch)
    if shown_um * step.step_um <= 0.0 or abs(shown_um) < CONFIRMING_SHARE * abs(step.step_um):
        return player
    force_mN = estimate.force_mN + shown_um / limits.compliance_um_per_mN
    seen = SeenStep(step, shown_um, force_mN, estimate.force_mN)
    if player.slip.confirmed is not None:
        seen = seen.after(player.slip.confirmed)
    player = with_slip(player, confirmed=seen)
    return _act(program, player, estimate, forwards=step.forwards)


def _act(program: Program, player: Player, estimate: ArmEstimate, *, forwards: bool) -> Player:
    """End, freeze or load again after a confirmed step."""
    segment, x_um = player.segment, estimate.x_um
    if segment.open_loop and rests(player):
        # The voltage is kept anyway.
        outcome = Outcome.POSITION_STEP if forwards else Outcome.SENSOR_JUMP
        return replace(player, outcome=outcome)
    if not forwards:
        player = replace(player, outcome=Outcome.SENSOR_JUMP)
        return _frozen(player) if rests(player) else _back(program, player, x_um)
    if rests(player):
        return _frozen(replace(player, outcome=Outcome.POSITION_STEP))
    K_e = _stiffness(program, player)
    player = _moved_line(with_slip(player, slips=player.slip.slips + 1), estimate, K_e)
    again = segment.phase == Phase.LOAD and isinstance(segment, Press)
    if again and player.slip.slips <= program.slip_retries:
        return enter(player, player.index, segment)
    return _back(program, replace(player, outcome=Outcome.SLIPPED), x_um)


def undecided_um(player: Player) -> float | None:
    """Return a confirmed step that the part or the sensor may have caused, in µm; None without one.

    A load that continues takes its steps for slips, until the motion back.
    """
    seen = player.slip.confirmed
    decided = not player.outcome and player.segment.phase not in UNWATCHED
    return None if seen is None or decided else seen.step_um


def within_plan(program: Program, player: Player, x_um: float) -> Player:
    """End a program whose references are about to leave the range of its plan.

    A force that cannot be reached within the range is not pursued: the part has slipped, or is
    softer than the plan admits.
    """
    planned = program.planned_range
    if planned is None or not player.segment.presses or player.segment.phase in UNWATCHED:
        return player
    most_mN, ref = planned.force_max_mN, player.ref
    if most_mN is not None and ref.force_mN > most_mN:
        ref = ref._replace(force_mN=most_mN)
        player = replace(player, ref=ref)
    low_um, high_um = planned.position_min_um, planned.position_max_um
    if high_um is not None and ref.x_um > high_um:
        player = replace(player, ref=ref._replace(x_um=high_um))
    elif low_um is not None and ref.x_um < low_um:
        player = replace(player, ref=ref._replace(x_um=low_um))
    else:
        return player
    if player.outcome:
        return player
    outcome = Outcome.SLIPPED if player.slip.slips else Outcome.WRONG_STIFFNESS
    return _back(program, replace(player, outcome=outcome), x_um)


def rests(player: Player) -> bool:
    """Return whether a part is held at rest, so that freezing the voltage is enough."""
    segment = player.segment
    if isinstance(segment, Drive):
        return segment.stays
    return segment.phase in KEPT or player.pause.active


def _moved_line(player: Player, estimate: ArmEstimate, K_e: float) -> Player:
    """Put the line through the newest sample, with the previous stiffness: x_e = x - F/K_e."""
    ref = player.ref._replace(x_um=estimate.x_um, speed_um_per_s=0.0, force_mN=estimate.force_mN)
    player = replace(player, line=ContactLine(), ref=ref, bump=True)
    return with_line(player, estimate.x_um - estimate.force_mN / K_e, K_e)


def _stiffness(program: Program, player: Player) -> float:
    """Return the contact stiffness that the references follow, or the planned one."""
    line = player.entry.line
    known = None if line is None else line.K_e_mN_per_um
    return known or program.contact_stiffness_mN_per_um


def _frozen(player: Player) -> Player:
    """Keep the voltage for the rest of the hold; in a pause, until the part is released."""
    if player.pause.active:
        return enter(replace(player, pause=NO_PAUSE), -1, Drive(Phase.HOLD, None))
    held = player.segment
    frozen = Drive(held.phase, held.duration_s, held.law)
    ref = player.ref._replace(voltages_V=player.applied_V)
    entry = player.entry._replace(ref=ref)
    pause = replace(player.pause, requested=False)
    return replace(player, segment=frozen, entry=entry, ref=ref, pause=pause)


def _back(program: Program, player: Player, x_um: float) -> Player:
    """Unload along the line, or retreat at once if the force is not known."""
    unload = next((one for one in program.segments if one.phase == Phase.UNLOAD), None)
    lines = player.outcome != Outcome.SENSOR_JUMP and unload is not None and unload.presses
    if lines or not has_phase(program, Phase.RETREAT):
        return jump(program, player, Phase.UNLOAD, x_um)
    return jump(program, player, Phase.RETREAT, x_um)
