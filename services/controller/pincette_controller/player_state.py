"""Where a program stands, its references at a tick, and its way from segment to segment."""

from msgspec import field
from msgspec.structs import replace

from pincette.control.force.position_steps import RestNoise, Step, StepWatch
from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.paths import Path
from pincette.control.planning.profiles import move, quintic, run_up
from pincette.control.planning.program import Program, Segment
from pincette.control.record import FrozenRecord
from pincette.core.faults import Outcome, Phase
from pincette_controller.pair_stand import PairStand


class SeenStep(FrozenRecord, frozen=True):
    """A step of the position that the voltage does not explain, and that was confirmed."""

    step: Step
    step_um: float
    """Its size, a mean over the samples since; positive towards the part."""
    force_mN: float
    """Estimated force just before it, or since where the sensor is its cause."""
    after_mN: float
    """Estimated force just after it, a mean likewise."""
    samples: int = 1

    def averaged(self, shown_um: float, force_mN: float) -> "SeenStep":
        """Return the step with one more sample in its means."""
        count = self.samples + 1
        mean_um = self.step_um + (shown_um - self.step_um) / count
        mean_mN = self.after_mN + (force_mN - self.after_mN) / count
        return replace(self, step_um=mean_um, after_mN=mean_mN, samples=count)

    def after(self, earlier: "SeenStep") -> "SeenStep":
        """Return this step with an earlier one added to it."""
        together_um = earlier.step_um + self.step_um
        return replace(self, step_um=together_um, force_mN=earlier.force_mN, samples=AVERAGED_OUT)


AVERAGED_OUT = 1_000_000
"""Count of samples of a step that is not averaged any further."""


class Player(FrozenRecord, frozen=True):
    """Where a program stands, and the references of the coming sample."""

    index: int
    segment: Segment
    ticks: int
    x_r_um: float
    speed_um_per_s: float
    force_r_mN: float
    from_x_um: float
    from_speed_um_per_s: float
    from_force_mN: float
    from_rate_mN_per_s: float = 0.0
    """At which F_r comes into the segment."""
    contact_x_um: float | None = None
    K_e_mN_per_um: float | None = None
    line: ContactLine = field(default_factory=ContactLine)
    count: int = 0
    """Consecutive samples that a guard has seen."""
    drift_mN: float = 0.0
    """The estimated force as an approach has it on average, in which a touch is a jump."""
    zeroing: bool = False
    """The estimator has been asked for a zero and has not answered."""
    zero: bool = False
    """The command of this tick carries the zero."""
    held: bool = False
    outcome: Outcome = Outcome.NONE
    ended: bool = False
    bump: bool = False
    """The law must be rebased before this tick: its force input begins or ends."""
    applied_V: float = 0.0
    """As the newest estimate has it."""
    from_V: float = 0.0
    """The voltage at which the segment began."""
    voltage_V: float = 0.0
    """What an open-loop segment asks for."""
    pausing: bool = False
    """A pause is requested, and begins at the next safe point."""
    paused: bool = False
    """The references rest, and the segment's time stands still."""
    resumed: bool = False
    """The pause has just ended: the newest sample is one of the rest."""
    begin_x_um: float = 0.0
    begin_V: float = 0.0
    """Where the program began."""
    begin_mN: float = 0.0
    """Force at the begin of a program that takes a held part over; 0 without a part. What is read
    there may have no zero, so that the guard of the force counts from it."""
    clear: bool = False
    """Whether the arm has been free on this way: only then a touch is one."""
    touching: int = 0
    """Consecutive samples of a touch."""
    touch_x_um: float | None = None
    touch_mN: float | None = None
    """What the arm met on its way through free space."""
    ends_after: str = ""
    """Phase under a law with which the program ends early; empty: none."""
    pair: PairStand | None = None
    """Of a rig of two arms; x_r is then the place of the part."""
    noise: RestNoise = field(default_factory=RestNoise)
    """Noise of the sensor, as the rests of this program show it."""
    noise_um: float = 0.0
    """The same as a number, at the end of the newest rest."""
    steps: StepWatch = field(default_factory=StepWatch)
    """Newest positions of a pressed part, for finding a step."""
    suspect: Step | None = None
    """Step that the next sample must confirm; the voltage is frozen until then."""
    seen_step: SeenStep | None = None
    """Step that was confirmed; None where there was none."""
    slips: int = 0
    """Number of times that the part has given way under moving references."""

    @property
    def pressing(self) -> bool:
        """Whether the force is an input of the law."""
        return self.segment.presses


class Foreseen(FrozenRecord, frozen=True):
    """Where a player will be a tick later, but for what a sample changes."""

    of: Player
    player: Player


def at_tick(player: Player, ticks: int, period_s: float) -> Player:
    """The player at ``ticks`` of its segment, with the references of the sample that follows."""
    segment, t_s = player.segment, ticks * period_s
    player = replace(player, ticks=ticks)
    if segment.kind == "free" and segment.x_to_um is not None and segment.duration_s:
        path = move(
            player.from_x_um,
            player.from_speed_um_per_s,
            segment.x_to_um,
            0.0,
            segment.duration_s,
        )
        return replace(player, x_r_um=path.position(t_s), speed_um_per_s=path.speed(t_s))
    if segment.kind == "seek" and segment.x_to_um is not None and segment.duration_s:
        way_um, up_s = segment.x_to_um - player.from_x_um, segment.move_s or 0.0
        gone_um, speed = run_up(way_um, segment.duration_s, up_s, t_s)
        return replace(player, x_r_um=player.from_x_um + gone_um, speed_um_per_s=speed)
    if segment.kind == "force" and segment.force_to_mN is not None:
        return _press(player, segment.force_to_mN, t_s)
    if segment.voltages_V:
        place = min(max(ticks, 1), len(segment.voltages_V)) - 1
        return replace(player, voltage_V=segment.voltages_V[place])
    if segment.kind == "voltage" and segment.voltage_to_V is not None and segment.duration_s:
        share = quintic(t_s / segment.duration_s)
        way_V = segment.voltage_to_V - player.from_V
        return replace(player, voltage_V=player.from_V + share * way_V)
    if segment.kind == "voltage" and segment.path is not None:
        begin_V = player.from_V if segment.path.relative else 0.0
        return replace(player, voltage_V=begin_V + segment.path.at(t_s))
    if segment.kind == "path" and segment.path is not None:
        return _track(player, segment.path, t_s)
    return replace(player, speed_um_per_s=0.0)


def _press(player: Player, force_to_mN: float, t_s: float) -> Player:
    """Move F_r and x_r together along the contact line."""
    duration_s = player.segment.move_s or player.segment.duration_s
    share = quintic(t_s / duration_s) if duration_s else 1.0
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if x_e_um is None or not K_e:
        return player
    if player.segment.follows and duration_s:
        load = move(player.from_force_mN, player.from_rate_mN_per_s, force_to_mN, 0.0, duration_s)
        force_r_mN = load.position(t_s)
        x_r_um = x_e_um + force_r_mN / K_e
        return replace(player, x_r_um=x_r_um, speed_um_per_s=0.0, force_r_mN=force_r_mN)
    x_to_um = x_e_um + force_to_mN / K_e
    return replace(
        player,
        x_r_um=player.from_x_um + share * (x_to_um - player.from_x_um),
        speed_um_per_s=0.0,
        force_r_mN=player.from_force_mN + share * (force_to_mN - player.from_force_mN),
    )


def _track(player: Player, path: Path, t_s: float) -> Player:
    """Follow a path, in force along the contact line or in position."""
    value, rate, _ = path.point(t_s)
    if path.quantity == "position":
        return replace(player, x_r_um=value, speed_um_per_s=rate)
    x_e_um, K_e = player.contact_x_um, player.K_e_mN_per_um
    if x_e_um is None or not K_e:
        return player
    return replace(player, x_r_um=x_e_um + value / K_e, speed_um_per_s=0.0, force_r_mN=value)


def enter(player: Player, index: int, segment: Segment) -> Player:
    """Return the player at the begin of a segment; references and voltage do not change."""
    return replace(
        player,
        index=index,
        segment=segment,
        ticks=0,
        count=0,
        from_x_um=player.x_r_um,
        from_speed_um_per_s=player.speed_um_per_s,
        from_force_mN=player.force_r_mN,
        from_rate_mN_per_s=0.0,
        from_V=player.applied_V,
        voltage_V=player.applied_V,
        # A step that was suspected in the segment before must not freeze this one.
        suspect=None,
        pair=None if player.pair is None else player.pair.entered(),
    )


def follow(program: Program, player: Player, x_um: float) -> Player:
    """Enter the segment after this one, or end."""
    index, segment = player.index + 1, player.segment
    early = segment.phase == player.ends_after and not segment.open_loop
    if segment.phase == Phase.STOPPING or early or index >= len(program.segments):
        return replace(player, ended=True, held=player.held and segment.phase != Phase.UNLOAD)
    return enter(leave(player, program.segments[index], x_um), index, program.segments[index])


def jump(program: Program, player: Player, phase: str, x_um: float) -> Player:
    """Go to the first segment of a phase, paused or not; a program without it ends."""
    player = replace(player, pausing=False, paused=False)
    for index, segment in enumerate(program.segments):
        if segment.phase == phase:
            return enter(leave(player, segment, x_um), index, segment)
    return replace(player, ended=True)


def has_phase(program: Program, phase: str) -> bool:
    """Whether a program has a phase."""
    return any(segment.phase == phase for segment in program.segments)


def leave(player: Player, following: Segment, x_um: float) -> Player:
    """Where the pressing ends, the law gets no force any more and x_r starts from x.

    Without a law a part that is pressed stays held.
    """
    if following.open_loop:
        return player
    if player.segment.open_loop:
        held = player.held and following.presses
        force_mN = player.force_r_mN if held else 0.0
        pair = None if player.pair is None else player.pair.left()
        return replace(player, held=held, bump=True, x_r_um=x_um, force_r_mN=force_mN, pair=pair)
    if not player.pressing or following.presses:
        return player
    if player.pair is not None:
        # The place stays as it is led; the opening begins where both arms are.
        left = player.pair.left()
        return replace(player, held=False, force_r_mN=0.0, speed_um_per_s=0.0, pair=left)
    return replace(player, held=False, bump=True, x_r_um=x_um, force_r_mN=0.0)
