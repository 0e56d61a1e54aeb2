"""Position in a program, its references in a tick, and the transitions between segments."""

from typing import Any

from msgspec import field
from msgspec.structs import replace

from pincette.control.force.freedom import FreedomFit
from pincette.control.force.position_steps import RestNoise, Step, StepWatch
from pincette.control.planning.contact_line import ContactLine, LoadLine
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Entry, Move, Reference, Segment
from pincette.control.record import FrozenRecord
from pincette.core.faults import Outcome, Phase
from pincette_controller.felt import Felt


class SeenStep(FrozenRecord, frozen=True):
    """A confirmed step of the position that the voltage does not explain."""

    step: Step
    step_um: float
    """Size of the step, averaged over the samples after the step, in µm; positive towards the
    part.
    """
    force_mN: float
    """Estimated force just before the step, in mN; the force after it if the sensor caused the
    step."""
    after_mN: float
    """Estimated force, averaged over the samples after the step, in mN."""
    samples: int = 1

    def averaged(self, shown_um: float, force_mN: float) -> "SeenStep":
        """Return the step with one more sample in its averages."""
        count = self.samples + 1
        mean_um = self.step_um + (shown_um - self.step_um) / count
        mean_mN = self.after_mN + (force_mN - self.after_mN) / count
        return replace(self, step_um=mean_um, after_mN=mean_mN, samples=count)

    def after(self, earlier: "SeenStep") -> "SeenStep":
        """Return this step with an earlier one added to it."""
        together_um = earlier.step_um + self.step_um
        return replace(self, step_um=together_um, force_mN=earlier.force_mN, samples=AVERAGED_OUT)


AVERAGED_OUT = 1_000_000
"""Sample count that stops the averaging of a step."""


class Pause(FrozenRecord, frozen=True):
    """Pause of a program."""

    requested: bool = False
    """True if a pause is requested; it begins at the next safe point."""
    active: bool = False
    """True while the references and the time of the segment are paused."""
    over: bool = False
    """True if the pause has just ended, so that the newest sample still belongs to it."""


NO_PAUSE = Pause()


class GuardWatch(FrozenRecord, frozen=True):
    """State of the guards from sample to sample."""

    count: int = 0
    """Number of consecutive samples in which the guard of this segment has found its condition."""
    drift_mN: float = 0.0
    """Mean of the estimated force on an approach, in mN; a contact is a jump above it."""
    clear: bool = False
    """True if the arm has been free during this motion; a contact counts only then."""
    touching: int = 0
    """Number of consecutive samples with contact."""
    zeroing: bool = False
    """True while a requested zero of the force is not yet confirmed."""


class SlipWatch(FrozenRecord, frozen=True):
    """Search for steps in the position of a pressed part, and its results."""

    noise: RestNoise = field(default_factory=RestNoise)
    """Noise of the sensor, measured in the rests of this program."""
    noise_um: float = 0.0
    """Standard deviation of the noise at the end of the newest rest, in µm."""
    steps: StepWatch = field(default_factory=StepWatch)
    """Newest positions, in which a step is searched for."""
    suspect: Step | None = None
    """Step that the next sample must confirm; the voltage is kept until then."""
    confirmed: SeenStep | None = None
    """Step that was confirmed; None without one."""
    slips: int = 0
    """Number of slips of the part while the references moved."""


class Began(FrozenRecord, frozen=True):
    """State in which a program began."""

    tips_um: tuple[float, ...] = (0.0,)
    """Position of each arm, in µm."""
    voltages_V: tuple[float, ...] = (0.0,)
    """Voltage applied to each arm, in V."""
    force_mN: float = 0.0
    """Force at the start of a program that takes over a held part, in mN; 0 without a part. It
    may not have been zeroed, so the force guard measures changes relative to it."""


class Touch(FrozenRecord, frozen=True):
    """Unexpected contact while the arm moves through free space."""

    x_um: float | None
    force_mN: float


class Player(FrozenRecord, frozen=True):
    """Current segment of the motion program, and the references of the next sample."""

    index: int
    segment: Segment
    ticks: int
    entry: Entry
    """State at the start of the segment, and what is known of the contact since then."""
    ref: Reference
    """References of the coming sample."""
    began: Began
    applied_V: tuple[float, ...]
    """Voltage applied to each arm according to the newest estimate, in V."""
    held: bool = False
    """True while a part is held."""
    line: ContactLine = field(default_factory=ContactLine)
    """Contact line of the load, fitted to its samples."""
    watch: GuardWatch = field(default_factory=GuardWatch)
    slip: SlipWatch = field(default_factory=SlipWatch)
    pause: Pause = NO_PAUSE
    freedom: tuple[FreedomFit, ...] = ()
    """Motion of each arm in a check of whether it is free; empty in other segments."""
    touch: Touch | None = None
    """Contact during the motion through free space; None without one."""
    felt: Felt | None = None
    """Forces and tip positions of two arms since the segment began; None with one arm."""
    outcome: Outcome = Outcome.NONE
    ended: bool = False
    ends_after: str = ""
    """Phase under a law with which the program ends early; empty if there is none."""
    zero: bool = False
    """True if the command of this tick requests a zero of the force."""
    bump: bool = False
    """True if the references restart in this tick, so that the law must be rebased."""

    @property
    def contact_known(self) -> bool:
        """True if the contact line, or the position of a part between two arms, is known."""
        return self.entry.line is not None or self.entry.held_at_um is not None


def enter(player: Player, index: int, segment: Segment) -> Player:
    """Return the player at the start of a segment; references and voltages do not change.

    A retreat never moves an arm forward: if a part pushes an arm back behind its home position, a
    motion to that position would press the part.
    """
    ref = player.ref._replace(force_rate_mN_per_s=0.0, voltages_V=player.applied_V)
    return replace(
        player,
        index=index,
        segment=_not_forward(segment, ref, player.felt),
        ticks=0,
        freedom=(),
        # A zero that was not confirmed belongs to the rest that ends here.
        watch=replace(player.watch, count=0, zeroing=False),
        entry=player.entry._replace(ref=ref),
        ref=ref,
        # A step that was suspected in the previous segment must not freeze this one.
        slip=replace(player.slip, suspect=None),
        felt=None if player.felt is None else player.felt.entered(),
    )


def with_watch(player: Player, **changes: float) -> Player:
    """Return the player with changed values in the state of its guards."""
    return replace(player, watch=replace(player.watch, **changes))


def with_slip(player: Player, **changes: Any) -> Player:
    """Return the player with changed values in its search for steps of the position."""
    return replace(player, slip=replace(player.slip, **changes))


def _not_forward(segment: Segment, ref: Reference, felt: Felt | None) -> Segment:
    """Limit the goals of a retreat to each arm's present position; other segments are unchanged."""
    if segment.phase != Phase.RETREAT or not isinstance(segment, Move):
        return segment
    tips_um = (ref.x_um,) if felt is None else felt.tips_um
    goals_um = tuple(
        None if goal_um is None else min(goal_um, tip_um)
        for goal_um, tip_um in zip(segment.to_um, tips_um, strict=True)
    )
    return segment if goals_um == segment.to_um else replace(segment, to_um=goals_um)


def with_line(player: Player, x_e_um: float, K_e_mN_per_um: float) -> Player:
    """Return the player with another contact line."""
    return replace(player, entry=player.entry._replace(line=LoadLine(x_e_um, K_e_mN_per_um)))


def enter_next(program: Program, player: Player, x_um: float) -> Player:
    """Enter the segment after this one, or end."""
    index, segment = player.index + 1, player.segment
    early = segment.phase == player.ends_after and not segment.open_loop
    if segment.phase == Phase.STOPPING or early or index >= len(program.segments):
        held = player.held and segment.phase != Phase.UNLOAD and not segment.lets_go
        return replace(player, ended=True, held=held)
    return enter(leave(player, program.segments[index], x_um), index, program.segments[index])


def jump(program: Program, player: Player, phase: str, x_um: float) -> Player:
    """Go to the last segment of a phase, also during a pause; a program without this phase
    ends.

    The last one, because a program of several grips must not make another grip after a fault.
    """
    player = replace(player, pause=NO_PAUSE)
    for index in reversed(range(len(program.segments))):
        segment = program.segments[index]
        if segment.phase == phase:
            return enter(leave(player, segment, x_um), index, segment)
    return replace(player, ended=True)


def has_phase(program: Program, phase: str) -> bool:
    """Return whether a program has a phase."""
    return any(segment.phase == phase for segment in program.segments)


def leave(player: Player, following: Segment, x_um: float) -> Player:
    """Return the player after the end of contact: the law gets no force, x_r starts from x.

    If the next segment has no law, a pressed part remains held.
    """
    if following.open_loop:
        return player
    if player.segment.open_loop:
        held = player.held and following.presses
        force_mN = player.ref.force_mN if held else 0.0
        ref = opened(player)._replace(x_um=x_um, force_mN=force_mN)
        return replace(player, held=held, bump=True, ref=ref)
    if not player.segment.presses or following.presses:
        return player
    ref = opened(player)._replace(force_mN=0.0, speed_um_per_s=0.0)
    if player.felt is not None:
        # The reference of the position q does not change; the opening begins at the present tip
        # positions.
        return replace(player, held=False, ref=ref)
    return replace(player, held=False, bump=True, ref=ref._replace(x_um=x_um))


def opened(player: Player) -> Reference:
    """Return the references; with two arms the opening is the measured one."""
    if player.felt is None:
        return player.ref
    return player.ref._replace(opening_um=sum(player.felt.tips_um), opening_speed_um_per_s=0.0)
