"""Position steps that the voltage does not explain, on an ideal arm and part."""

from random import Random

import pytest
from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.load_line import MOST_STIFFNESS
from pincette.control.planning.program import Program
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.actions import release
from pincette_controller.player import advance
from pincette_controller.slipping import admissible, undecided_um

from .ideal_arm import K_E, PROGRAM, Arm, T, line_of
from .test_quick_grip import QUICK

S_P, NOISE_UM, SEED = 0.46, 0.03, 46
LIMITS = StepLimits(NOISE_UM, S_P, T)


class Sensed(Arm):
    """An arm with a noisy sensor that may jump, at a part that may slip.

    ``x_1`` is constant while the references do not move, so a slip moves the arm forwards and
    reduces the force.
    """

    def __init__(
        self,
        program: Program = PROGRAM,
        *,
        stiffness: float = K_E,
        noise_um: float = NOISE_UM,
        seed: int = SEED,
    ) -> None:
        super().__init__(stiffness=stiffness, program=program)
        self.random, self.noise_um = Random(seed), noise_um
        self.limits = StepLimits(noise_um, S_P, T)
        self.jump_um = 0.0
        self.free_um = 0.0

    def estimate(self) -> ArmEstimate:
        plain, noise_um = super().estimate(), self.random.gauss(0.0, self.noise_um)
        x_um, force_mN = plain.x_um, plain.force_mN
        off_um = self.jump_um + noise_um
        self.free_um = x_um + S_P * force_mN
        return replace(
            plain, x_um=x_um + off_um, force_mN=force_mN - off_um / S_P, applied_V=self.free_um
        )

    def tick(self) -> None:
        estimate = self.estimate()
        self.player = advance(self.program, self.player, (estimate,), T, self.limits)
        self.seq += 1
        if self.player.zero:
            self.zeroed = self.seq
        if not self.phases or self.phases[-1] != self.player.segment.phase:
            self.phases.append(self.player.segment.phase)

    def slip(self, by_um: float) -> None:
        """Let the part slip at constant voltage, by the share of it that the arm follows."""
        kappa = S_P * self.stiffness
        self.contact_um += by_um
        x_um = self.player.ref.x_um + by_um * kappa / (1.0 + kappa)
        self.player = replace(self.player, ref=self.player.ref._replace(x_um=x_um))


def loaded(program: Program, ticks: int) -> Sensed:
    arm = Sensed(program)
    arm.until("load")
    for _ in range(ticks):
        arm.tick()
    return arm


@pytest.mark.parametrize("program", [PROGRAM, QUICK], ids=["gentle", "quick"])
def test_a_healthy_grip_has_no_step(program: Program) -> None:
    arm = Sensed(program)
    arm.until()
    assert arm.player.outcome == "gripped"
    assert arm.player.slip.confirmed is None


@pytest.mark.parametrize("program", [PROGRAM, QUICK], ids=["gentle", "quick"])
def test_after_a_slip_during_the_load_the_unload_uses_a_corrected_contact_line(
    program: Program,
) -> None:
    arm = loaded(program, 8)
    arm.slip(3.0)
    arm.until("unload")
    player = arm.player
    assert player.outcome == "slipped"
    assert player.slip.slips == 1
    assert player.slip.confirmed is not None
    assert player.slip.confirmed.step_um == pytest.approx(3.0 * 0.92 / 1.92, abs=0.2)
    assert line_of(player).x_e_um == pytest.approx(arm.contact_um, abs=0.5)
    assert line_of(player).K_e_mN_per_um == pytest.approx(K_E, rel=0.3)
    arm.until()
    assert arm.player.outcome == "slipped"
    assert not arm.player.held


def test_a_load_continues_after_a_slip_as_often_as_permitted() -> None:
    arm = loaded(replace(PROGRAM, slip_retries=2), 10)
    for slips in (1, 2):
        arm.slip(3.0)
        for _ in range(2):
            arm.tick()
        assert arm.player.slip.slips == slips
        assert undecided_um(arm.player) is None
        assert arm.player.segment.phase == "load"
        assert arm.player.line.count == 0
        for _ in range(10):
            arm.tick()
    arm.until()
    assert arm.player.outcome == "gripped"
    assert arm.player.slip.slips == 2
    arm = loaded(replace(PROGRAM, slip_retries=1), 10)
    for _ in range(2):
        arm.slip(3.0)
        for _ in range(12):
            arm.tick()
    arm.until()
    assert arm.player.outcome == "slipped"


@pytest.mark.parametrize(
    ("jump_um", "outcome"), [(-0.4, "sensor_jump"), (-2.0, "sensor_jump"), (2.0, "position_step")]
)
def test_a_step_in_a_hold_freezes_the_voltage_from_its_first_sample(
    jump_um: float, outcome: str
) -> None:
    endless = replace(PROGRAM.segments[4], duration_s=None)
    program = replace(PROGRAM, segments=(*PROGRAM.segments[:4], endless, *PROGRAM.segments[5:]))
    arm = Sensed(program)
    arm.until("hold")
    for _ in range(20):
        arm.tick()
    arm.jump_um = jump_um
    arm.tick()
    assert arm.player.slip.suspect is not None
    held_V = arm.free_um
    for _ in range(30):
        arm.tick()
    assert arm.player.outcome == outcome
    assert arm.player.segment.open_loop
    assert arm.player.held
    assert arm.player.ref.voltages_V[0] == pytest.approx(held_V)
    seen = arm.player.slip.confirmed
    assert seen is not None
    assert seen.step_um == pytest.approx(jump_um, abs=0.1)
    assert seen.force_mN == pytest.approx(20.0, abs=0.4)
    assert seen.after_mN == pytest.approx(20.0 - jump_um / S_P, abs=0.4)
    assert undecided_um(arm.player) == seen.step_um
    arm.player = release(program, arm.player)
    arm.until()
    assert arm.player.outcome == outcome
    assert undecided_um(arm.player) == seen.step_um


def test_a_single_outlier_changes_nothing() -> None:
    arm = Sensed()
    arm.until("hold")
    for _ in range(10):
        arm.tick()
    arm.jump_um = 5.0
    arm.tick()
    arm.jump_um = 0.0
    arm.until()
    assert arm.player.outcome == "gripped"
    assert arm.player.slip.confirmed is None


@pytest.mark.parametrize("share", [0.31, 1.0, 2.9])
def test_a_stiffness_near_the_plan_may_be_used(share: float) -> None:
    assert admissible(PROGRAM, share * K_E)


@pytest.mark.parametrize("share", [-0.004, 0.0, 0.29, 3.1])
def test_an_impossible_stiffness_is_never_used(share: float) -> None:
    """-0.009 mN/µm with x_e = 863 µm drove the arm to its end once."""
    assert not admissible(PROGRAM, share * K_E)
    arm = Arm()
    arm.until("load")
    while arm.player.segment.phase == "load":
        arm.tick()
        line = arm.player.line
        # A load whose force falls or stays constant while the arm moves on.
        x_um = line.first_x_um + 0.5 * line.count
        force_mN = 12.0 + share * K_E * 0.5 * line.count
        forged = line.add(x_um, force_mN, 2.0 + line.count)
        arm.player = replace(arm.player, line=forged)
        K_e = line_of(arm.player).K_e_mN_per_um
        assert K_e is not None
        assert 0.3 * K_E <= K_e <= MOST_STIFFNESS * K_E
    assert arm.player.ref.x_um < 40.0


def small_load(force_mN: float) -> Program:
    """Return a grip with a short load to a small force; the part may differ by 30 %."""
    zero, approach, contact, load, hold, *others = PROGRAM.segments
    contact = replace(contact, duration_s=2.0, to_um=(18.0,))
    pressing = (replace(load, duration_s=0.2, to_mN=force_mN), replace(hold, to_mN=force_mN))
    guards = replace(
        PROGRAM.guards, stiffness_min_mN_per_um=0.7 * K_E, stiffness_max_mN_per_um=1.3 * K_E
    )
    return replace(PROGRAM, segments=(zero, approach, contact, *pressing, *others), guards=guards)


@pytest.mark.parametrize(("force_mN", "noise_um"), [(6.6, 0.128), (5.0, 0.15), (10.0, 0.15)])
def test_noise_over_a_small_load_is_not_reported_as_a_wrong_stiffness(
    force_mN: float, noise_um: float
) -> None:
    program, lines = small_load(force_mN), list[float]()
    for seed in range(40):
        arm = Sensed(program, noise_um=noise_um, seed=seed)
        arm.until("hold")
        assert arm.player.outcome == ""
        lines.append(line_of(arm.player).K_e_mN_per_um)
        arm.until()
        assert arm.player.outcome == "gripped"
    assert min(lines) >= 0.65 * K_E
    assert max(lines) <= 1.35 * K_E


@pytest.mark.parametrize(
    ("share", "force_mN", "noise_um"),
    [(1.6, 6.6, 0.03), (0.5, 6.6, 0.03), (3.0, 10.0, 0.05), (0.4, 15.0, 0.128)],
)
def test_a_part_is_released_if_its_stiffness_is_wrong_by_more_than_the_noise_explains(
    share: float, force_mN: float, noise_um: float
) -> None:
    program = small_load(force_mN)
    for seed in range(10):
        arm = Sensed(program, stiffness=share * K_E, noise_um=noise_um, seed=seed)
        arm.until()
        assert arm.player.outcome == "wrong_stiffness"
