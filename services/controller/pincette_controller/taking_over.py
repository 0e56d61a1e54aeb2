"""Programs that begin with a held part, at the force that acts on it.

The references begin at the measured position of the arm, with the estimated force, so that neither
they nor the voltage jump. The contact line of one arm goes through that sample with the stiffness
of the hardest part. It is then fitted to the samples of the load, whether the force rises or falls:
a falling force is at first above its reference, and the contact is not lost. Two arms have no
contact line: their law controls the force itself.

A force that was not zeroed is unknown. In that case the voltage does not change: the part is held
as it is.
"""

from msgspec.structs import replace

from pincette.control.planning.load_line import stiffness_bounds
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Entry, Press, Reference
from pincette.core.faults import Outcome, Phase
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.felt import Arms
from pincette_controller.force_bounds import is_uncertain
from pincette_controller.player_state import NO_PAUSE, Began, Player, enter, with_line
from pincette_controller.slipping import admissible

LARGEST_ERROR = 0.02
"""Largest relative standard error of the fitted stiffness at which the fit is used."""


def take_over(program: Program, estimate: ArmEstimate, period_s: float) -> Player:
    """Return a player at the first segment, with the estimated force."""
    x_um, force_mN, applied_V = estimate.x_um, estimate.force_mN, estimate.applied_V
    ref = Reference(x_um, force_mN=force_mN, voltages_V=(applied_V,))
    player = Player(
        0,
        program.segments[0],
        0,
        Entry(ref, period_s),
        ref,
        # The force has a zero, so the limit of the force counts from 0.
        Began((x_um,), (applied_V,)),
        (applied_V,),
        held=True,
    )
    _, hardest = stiffness_bounds(program.contact_stiffness_mN_per_um, program.guards)
    return with_line(player, x_um - force_mN / hardest, hardest)


def force_unknown(player: Player, arms: Arms) -> bool:
    """Return whether the force on a held part has no zero or too large a U."""
    segment = player.segment
    if segment.phase != Phase.LOAD or player.outcome:
        return False
    goal_mN = segment.to_mN if isinstance(segment, Press) else None
    return any(arm.zero_age_s is None or is_uncertain(arm, goal_mN) for arm in arms)


def keep_as_it_is(player: Player) -> Player:
    """Keep the voltage of a part whose force is not known, until the part is released."""
    kept = replace(player, outcome=Outcome.UNCERTAIN_FORCE, pause=NO_PAUSE)
    return enter(kept, -1, Drive(Phase.STOPPED, None, player.segment.law))


def settle_held(program: Program, player: Player) -> Player:
    """Adopt the contact line fitted over the load, if the fit is certain and admissible.

    Unlike in a grip, a wrong stiffness does not end the program, since the part is held already.
    """
    fit = player.line.fit()
    if fit is None or not admissible(program, fit.K_e_mN_per_um):
        return player
    if fit.K_e_error_mN_per_um > LARGEST_ERROR * fit.K_e_mN_per_um:
        return player
    return with_line(player, fit.x_e_um, fit.K_e_mN_per_um)
