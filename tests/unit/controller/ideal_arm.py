"""An ideal arm that is always at its reference, and a part; a grip and a track to play with it."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Rest, Seek, Track
from pincette.core.faults import Fault
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.player import advance, begin
from pincette_controller.player_state import Player

T = 0.02
K_E = 2.0
GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.5, 1.0)
PROGRAM = Program(
    (
        Rest("zero", 0.1, guarded=True),
        Move("approach", 0.4, guarded=True, to_um=(10.0,)),
        Seek("contact", 1.0, to_um=(14.0,)),
        Press("load", 0.4, to_mN=20.0),
        Press("hold", 0.4, to_mN=20.0, move_s=0.2),
        Press("unload", 0.4, to_mN=0.0),
        Move("retreat", 0.4, guarded=True, to_um=(0.0,)),
    ),
    GUARDS,
    K_E,
)
SWING = sinusoid("force", 10.0, 16.0, 2.0, 2)
TRACK = replace(
    PROGRAM,
    segments=(
        *PROGRAM.segments[:4],
        Press("load", 0.4, to_mN=10.0),
        Press("settle", 0.4, to_mN=10.0, move_s=0.2),
        Track("track", SWING.duration_s, force=SWING),
        *PROGRAM.segments[5:],
    ),
)
BLANK = ArmEstimate(0.0, 0.0, 0.1, 0.0, None, None, 0.0, 0)


def line_of(player: Player) -> LoadLine:
    """Return the contact line that the references follow."""
    assert player.entry.line is not None
    return player.entry.line


class Arm:
    """An arm at its reference position, and a part at ``contact_um`` with ``stiffness``."""

    def __init__(
        self, contact_um: float = 12.0, stiffness: float = K_E, program: Program = PROGRAM
    ) -> None:
        self.program = program
        self.contact_um: float = contact_um
        self.stiffness = stiffness
        self.refusal: Fault | None = None
        self.lost = False
        self.uncertainty_mN = BLANK.force_uncertainty_mN
        self.zeroed: float | None = None
        self.player: Player = begin(program, (BLANK,), T)
        self.phases: list[str] = []
        self.seq = 0

    def estimate(self) -> ArmEstimate:
        x = self.player.ref.x_um
        force = 0.0 if self.lost else self.stiffness * max(0.0, x - self.contact_um)
        age = None if self.zeroed is None else (self.seq - self.zeroed) * T
        return replace(
            BLANK,
            x_um=x,
            force_mN=force,
            force_uncertainty_mN=self.uncertainty_mN,
            zero_age_s=age,
            zero_refusal=self.refusal,
            touch_x_um=x if force > BLANK.force_uncertainty_mN else None,
            touch_mN=force - BLANK.force_uncertainty_mN if force > 0.1 else None,
        )

    def tick(self) -> None:
        self.player = advance(self.program, self.player, (self.estimate(),), T)
        self.seq += 1
        if self.player.zero and not self.refusal:
            self.zeroed = self.seq
        if not self.phases or self.phases[-1] != self.player.segment.phase:
            self.phases.append(self.player.segment.phase)

    def until(self, phase: str = "") -> None:
        for _ in range(1000):
            self.tick()
            if self.player.ended or self.player.segment.phase == phase:
                return
        pytest.fail(f"did not reach {phase or 'the end'}; phases: {self.phases}")
