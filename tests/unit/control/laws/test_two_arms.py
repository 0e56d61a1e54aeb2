"""The law of two arms: compared with its transcription, and its properties on two ideal arms."""

import json
from math import pi, sin

import pytest
from msgspec.structs import replace

from pincette.control.arm.plant import ArmParameters, OutputTiming, consistent_arm
from pincette.control.laws import two_arms
from pincette.control.laws.two_arms import Pair, TwoArmReferences
from tests.unit.control.laws import two_arms_case
from tests.unit.control.laws.two_arms_case import CASES, GOLDEN, OMEGAS, ZETAS, C, Case, S

ARMS: tuple[ArmParameters, ArmParameters] = (
    consistent_arm(OMEGAS[0], ZETAS[0], 19.0, S[0]),
    consistent_arm(OMEGAS[1], ZETAS[1], 17.0, S[1]),
)
GAP_UM = 60.0
LONG = {"n": 1.0, "f_q": 5.5, "f_F": 3.0}


def _made(case: Case) -> two_arms.TwoArmParameters:
    gains = {"n": float(case.n), "f_q": case.f_q, "f_F": case.f_F}
    output = OutputTiming(case.delay_s, case.lag_s)
    return two_arms.build(ARMS, gains, case.period_s, C, output)


def _played(case: Case) -> list[Pair]:
    made, state = _made(case), two_arms.start()
    found: list[Pair] = []
    for k in range(two_arms_case.TICKS):
        now = two_arms_case.sample(case, k)
        references = TwoArmReferences(
            place_um=now.q[0],
            force_mN=now.F_r[0],
            opening_um=now.d[0],
            pressed=now.pressed,
            place_speed_um_per_s=now.q[1],
            place_acceleration_um_per_s2=now.q[2],
            force_rate_mN_per_s=now.F_r[1],
            opening_speed_um_per_s=now.d[1],
        )
        state, output = two_arms.step(
            made, state, tips_um=now.x, free_um=now.H, forces_mN=now.F, references=references
        )
        found.append(output.free_um)
    return found


@pytest.mark.parametrize("case", CASES, ids=str)
def test_every_tick_equals_the_transcription_of_the_paper(case: Case) -> None:
    for mine, other in zip(_played(case), two_arms_case.transcribed(case), strict=True):
        assert mine == pytest.approx(other, abs=1e-9)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_golden_vectors_are_reproduced(case: Case) -> None:
    golden = json.loads(GOLDEN.read_text())[str(tuple(case))]
    played = _played(case)
    for tick, values in golden.items():
        assert played[int(tick)] == pytest.approx(tuple(values), abs=1e-9)


class Ideal:
    """Two quasi-static arms whose free response has an offset and a slope error, and a part."""

    def __init__(self, slopes: Pair = (1.0, 1.0), offsets_um: Pair = (0.0, 0.0)) -> None:
        self.made = two_arms.build(ARMS, LONG, 0.02, C)
        self.state, self.slopes, self.offsets_um = two_arms.start(), slopes, offsets_um
        self.free_um: Pair = (31.0, 30.0)
        self.pressed = True

    def force_mN(self) -> float:
        X_1, X_2 = self._true_um()
        return max(0.0, (X_1 + X_2 - GAP_UM) / (S[0] + S[1] + C)) if self.pressed else 0.0

    def tips_um(self) -> Pair:
        X_1, X_2 = self._true_um()
        force = self.force_mN()
        return X_1 - S[0] * force, X_2 - S[1] * force

    def place_um(self) -> float:
        x_1, x_2 = self.tips_um()
        return 0.5 * (x_1 - x_2)

    def tick(self, references: TwoArmReferences) -> two_arms.TwoArmOutput:
        x, force = self.tips_um(), self.force_mN()
        self.state, output = two_arms.step(
            self.made,
            self.state,
            tips_um=x,
            free_um=self.free_um,
            forces_mN=(force, force),
            references=references,
        )
        self.free_um = output.free_um
        return output

    def _true_um(self) -> Pair:
        return (
            self.offsets_um[0] + self.slopes[0] * self.free_um[0],
            self.offsets_um[1] + self.slopes[1] * self.free_um[1],
        )


def test_place_and_force_move_independently_if_the_model_is_exact() -> None:
    arms = Ideal()
    arms.tick(TwoArmReferences(place_um=arms.place_um(), force_mN=arms.force_mN()))
    for k in range(400):
        place, force = 2.0 * sin(0.03 * k), 15.0 + 5.0 * sin(0.02 * k + 1.0)
        arms.tick(TwoArmReferences(place_um=place, force_mN=force))
        assert arms.place_um() == pytest.approx(place, abs=1e-9)
        if k > 40:
            assert arms.force_mN() == pytest.approx(force, abs=1e-6)


def test_neither_reference_moves_the_other_quantity() -> None:
    arms = Ideal()
    first = TwoArmReferences(place_um=0.3, force_mN=12.0)
    for _ in range(100):
        arms.tick(first)
    arms.tick(replace(first, place_um=3.0))
    assert arms.force_mN() == pytest.approx(12.0, abs=1e-9)
    assert arms.place_um() == pytest.approx(3.0, abs=1e-9)
    arms.tick(replace(first, place_um=3.0, force_mN=20.0))
    assert arms.place_um() == pytest.approx(3.0, abs=1e-9)
    assert arms.force_mN() == pytest.approx(20.0, abs=1e-9)


def test_errors_of_slope_and_offset_are_corrected_in_place_and_force() -> None:
    arms = Ideal(slopes=(1.1, 0.85), offsets_um=(-3.0, 5.0))
    wanted = TwoArmReferences(place_um=1.0, force_mN=10.0)
    for _ in range(150):
        arms.tick(wanted)
    assert arms.place_um() == pytest.approx(1.0, abs=1e-6)
    assert arms.force_mN() == pytest.approx(10.0, abs=1e-6)


def test_an_error_of_the_place_decays_with_the_pole_of_the_law() -> None:
    arms = Ideal()
    wanted = TwoArmReferences(place_um=0.3, force_mN=12.0)
    for _ in range(100):
        arms.tick(wanted)
    one, two = arms.offsets_um
    arms.offsets_um = one + 0.5, two - 0.5
    off_um = arms.place_um() - 0.3
    share = 1.0 - two_arms.build(ARMS, LONG, 0.02).place_poles.one
    for _ in range(4):
        arms.tick(wanted)
        off_um *= 1.0 - share
        assert arms.place_um() - 0.3 == pytest.approx(off_um, abs=1e-9)


@pytest.mark.parametrize("seeks", [True, False])
def test_position_errors_of_arms_that_seek_the_part_are_not_corrected(seeks: bool) -> None:
    arms = Ideal()
    arms.pressed = False
    rest = TwoArmReferences(place_um=0.0, opening_um=50.0, pressed=False)
    for _ in range(200):
        arms.tick(rest)
    before_um = arms.free_um
    one, two = arms.offsets_um
    arms.offsets_um = one - 0.5, two
    arms.tick(replace(rest, seeks=seeks))
    arms.tick(replace(rest, seeks=seeks))
    assert (arms.free_um == pytest.approx(before_um, abs=1e-6)) is seeks


@pytest.mark.parametrize("pressed", [True, False])
def test_the_first_step_and_a_change_of_contact_cause_no_jump_at_the_references(
    pressed: bool,
) -> None:
    arms = Ideal(offsets_um=(0.4, -0.7))
    arms.pressed = pressed
    wanted = TwoArmReferences(
        place_um=arms.place_um(),
        force_mN=arms.force_mN(),
        opening_um=sum(arms.tips_um()),
        pressed=pressed,
    )
    if pressed:
        # s_1 and s_2 differ: the plan's own force, not the estimate, determines the position.
        assert arms.force_mN() > 0.0
    before = arms.free_um
    for _ in range(3):
        assert arms.tick(wanted).free_um == pytest.approx(before, abs=1e-9)
    changed = replace(wanted, pressed=not pressed)
    x, force = arms.tips_um(), arms.force_mN()
    uneven_um = 0.5 * (S[0] - S[1]) * (0.0 if pressed else force)
    _, output = two_arms.step(
        arms.made,
        arms.state,
        tips_um=x,
        free_um=before,
        forces_mN=(force, force),
        references=changed,
    )
    assert sum(output.free_um) == pytest.approx(sum(before), abs=1e-9)
    assert abs(output.free_um[0] - before[0]) <= 2.0 * abs(S[0] - S[1]) * force + abs(uneven_um)


def test_a_swing_of_the_held_part_is_hardly_mistaken_for_a_force() -> None:
    alike = (ARMS[0], ARMS[0])
    made, state = two_arms.build(alike, LONG, 0.02, C), two_arms.start()
    swing_um = 0.2 * sin(0.25 * pi)
    _, output = two_arms.step(
        made,
        state,
        tips_um=(30.0 + swing_um, 30.0 - swing_um),
        free_um=(34.0, 34.0),
        forces_mN=((4.0 - swing_um) / S[0], (4.0 + swing_um) / S[0]),
        references=TwoArmReferences(place_um=0.0, force_mN=4.0 / S[0]),
    )
    assert output.force_mN == pytest.approx(4.0 / S[0], abs=1e-9)
    assert output.disagreement_mN == pytest.approx(-2.0 * swing_um / S[0], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"n": 2.5}, "whole number of poles"),
        ({"n": 5.0}, "from 1 to 4"),
        ({"f_q": 0.0}, "f_q"),
        ({"f_F": -1.0}, "f_F"),
    ],
)
def test_gains_that_are_invalid_are_refused(change: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        two_arms.build(ARMS, LONG | change, 0.02)


def test_a_delay_beyond_the_next_period_is_refused() -> None:
    with pytest.raises(ValueError, match="longer period"):
        two_arms.build(ARMS, LONG, 0.001, C, OutputTiming(0.002, 0.0))


def test_default_gains_follow_the_period() -> None:
    assert two_arms.default_gains(OMEGAS[0], 0.02) == LONG
    assert two_arms.default_gains(OMEGAS[0], 0.001)["n"] == 3.0
