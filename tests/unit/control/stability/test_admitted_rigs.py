"""Rigs drawn at random within the stated set do not diverge with a loop that the assessment admits.

The law's own step drives the exact arm, whose contact begins and ends within a tenth of a period.
The arm moves into a part, and the law is informed of the contact some samples later. It then
presses on a sinusoid with noise and moves back; the law is informed of the loss late again. As in a
program, each contact and each loss is reported once.

    .venv/bin/python -m tests.unit.control.stability.test_admitted_rigs 1000

plays as many rigs and prints how far their arms deviate.
"""

import sys
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from pincette.control.laws import law as control_law
from pincette.control.laws.planned_motion import PlannedMotion
from pincette.control.planning.profiles import move
from pincette.control.stability.assessment import assess
from pincette.control.stability.loop_matrix import Loop
from tests.support.laws import step_at

from .test_short_periods import ARM, PART, loop_of

LOOPS = {
    "1 ms": loop_of(0.001),
    "1 ms, n = 4": loop_of(0.001, n=4.0, f_w=100.0),
    "0.5 ms": loop_of(0.0005, n=4.0, f_w=150.0),
    "2 ms, slow": loop_of(0.002, n=3.0, f_w=6.0),
}
RIGS, SEED = 8, 11
X_E_UM, K_E = 30.0, 2.17
FREE_S, PRESSED_S, AWAY_S = 0.08, 0.3, 0.2
AMPLITUDE_UM, DEPTH_UM, HZ = 3.0, 5.0, 8.0
NOISE_UM = 0.03
PIECES = 10


@dataclass(frozen=True, slots=True)
class Rig:
    case: LoopCase
    late_ticks: int
    """Time from a contact or a loss until the law is informed."""


def drawn(number: int, seed: int) -> list[Rig]:
    """Draw rigs in the whole set, half of them at its limits."""
    chance = np.random.default_rng(seed)

    def within(low: float, high: float) -> float:
        share = float(chance.uniform())
        return low + (high - low) * (share if chance.uniform() < 0.5 else round(share))

    return [
        Rig(
            LoopCase(
                K_E * within(0.5, 2.0),
                within(0.8, 1.2),
                within(0.3, 1.0),
                within(0.7, 1.2),
                within(0.77, 1.35),
            ),
            int(chance.integers(2, 12)),
        )
        for _ in range(number)
    ]


def reference(t_s: float) -> tuple[float, float, float, bool]:
    """Return x_r, its derivatives, and whether the plan presses."""
    w = 2.0 * pi * HZ
    if t_s < FREE_S:
        return X_E_UM + 40.0 * (t_s - FREE_S), 40.0, 0.0, False
    t_s -= FREE_S
    if t_s < PRESSED_S:
        swing = AMPLITUDE_UM * w
        x = X_E_UM + DEPTH_UM * (1.0 - cos(20.0 * t_s)) / 2.0 + AMPLITUDE_UM * sin(w * t_s) / 2.0
        v = 50.0 * sin(20.0 * t_s) + 0.5 * swing * cos(w * t_s)
        return x, v, 1000.0 * cos(20.0 * t_s) - 0.5 * w * swing * sin(w * t_s), True
    back = move(X_E_UM, 0.0, X_E_UM - 4.0, 0.0, 0.5 * AWAY_S)
    t_s -= PRESSED_S
    return back.position(t_s), back.speed(t_s), back.acceleration(t_s), False


def furthest_um(loop: Loop, rig: Rig, seed: int) -> float:
    """Return the largest |x - x_r| of the arm itself over the last tenth of a second."""
    T, case, chance = loop.period_s, rig.case, np.random.default_rng(seed)
    law = control_law.build(replace_set(loop), ARM, T, 0.0, output=loop.assumed_timing)
    rest = case.frequency_factor, 0.0, case.gain_factor, case.damping_factor
    cases = LoopCase(0.0, *rest), LoopCase(case.K_e_mN_per_um, *rest)
    transitions, drives = sampled_arms(loop.arm, T / PIECES, 0.0, cases)
    late = round(case.delay_periods * PIECES)
    gain, kappa = ARM.d / ARM.k * case.gain_factor, case.K_e_mN_per_um / ARM.k
    x0 = X_E_UM - 40.0 * FREE_S
    z = np.array([x0, 0.0, 0.0, x0 / gain])
    state = control_law.start(law, x_um=x0, x_r_um=x0, force_mN=0.0, applied_V=z[3])
    reported, gone, waited, off_um = False, False, 0, 0.0
    for tick in range(round((FREE_S + PRESSED_S + AWAY_S) / T)):
        x = float(z[0])
        x_r, v, a, _ = reference((tick + 1) * T)
        touched = x > X_E_UM
        # The contact is reported after the required samples, its loss after the plan has released
        # the part.
        met = touched if not reported else tick * T > FREE_S + PRESSED_S
        waited = waited + 1 if met else 0
        if waited > rig.late_ticks and not gone:
            reported, gone, waited = not reported, reported, 0
            at: dict[str, Any] = {"x_um": x, "x_r_um": x_r, "force_mN": 0.0, "force_r_mN": 0.0}
            state = control_law.rebase(law, state, **at)
        seen = x + NOISE_UM * float(chance.standard_normal())
        # The estimator's force uses its own slope, quasi-static.
        F = (ARM.d / ARM.k * z[3] - seen) * ARM.k if reported else 0.0
        F_r = K_E * (x_r - X_E_UM) if reported else 0.0
        state, output = step_at(
            law,
            state,
            (seen, F, float(z[3])),
            (x_r, F_r),
            plan=PlannedMotion(v, a, K_E if reported else 0.0, X_E_UM if reported else 0.0),
        )
        old_V = float(z[3])
        for piece in range(PIECES):
            # Relative to the arm's rest position on the spring: x_e is part of the equilibrium.
            pressed = int(z[0] > X_E_UM)
            base_um = X_E_UM * kappa / (1.0 + kappa) if pressed else 0.0
            z[0] -= base_um
            z = transitions[pressed] @ z
            z += drives[pressed] * (old_V if piece < late else output.voltage_V)
            z[0] += base_um
        if (tick + 1) * T > FREE_S + PRESSED_S + AWAY_S - 0.1:
            off_um = max(off_um, abs(float(z[0]) - x_r))
    return off_um


def replace_set(loop: Loop) -> Any:
    """Use the law of the line, which fits the arm here."""
    return type(loop.law)(loop.law.definition, "consistent", "planned", loop.law.values)


@pytest.mark.parametrize("name", LOOPS)
def test_no_random_rig_diverges_with_an_admitted_loop(name: str) -> None:
    assert assess(LOOPS[name], PART).stable
    for number, rig in enumerate(drawn(RIGS, SEED)):
        assert furthest_um(LOOPS[name], rig, number) < 2.0, (SEED, number, rig)


def test_a_refused_loop_diverges_on_a_drawn_rig() -> None:
    """The trial can fail, and does so near the limit of the set."""
    loop = loop_of(0.001, f_w=130.0)
    assert not assess(loop, PART).stable
    reached = [furthest_um(loop, rig, number) for number, rig in enumerate(drawn(40, SEED))]
    assert max(reached) > 10.0


def main(number: int) -> None:
    for name, loop in LOOPS.items():
        found = [furthest_um(loop, rig, n) for n, rig in enumerate(drawn(number, SEED + 1))]
        middle, worst = float(np.median(found)), max(found)
        print(f"{name}: {number} rigs, |x - x_r| after the loss {middle:.3f} ({worst:.3f}) µm")


if __name__ == "__main__":
    main(int(sys.argv[1]))
