"""Peaks of the true force in loads during which the part slips, over random noise.

A load to 20 mN in 0.45 s, a part of 2.17 mN/µm that slips at 12 mN, samples each 20 ms. The arm is
quasi-static: its free position follows the references, minus the deflection by the part.
"""

from dataclasses import dataclass
from random import Random
from statistics import median

import pytest
from msgspec.structs import replace

from pincette.control.force.position_steps import StepLimits
from pincette.control.planning.program import PlannedRange, Program
from pincette.control.voltage_range import VoltageRange
from pincette.core.messages.arms import ArmEstimate
from pincette_controller.player import advance, begin
from pincette_controller.player_state import Player

from .ideal_arm import BLANK, T
from .test_quick_grip import LOAD, QUICK

S_P, K_E, CONTACT_UM, SLIPS_MN, LOAD_MN, LOAD_S = 0.46, 2.17, 12.0, 12.0, 20.0, 0.45
FEW, ALL, SEED = 12, 200, 461
FURTHEST_UM = 14.0 + LOAD_MN / (K_E / 1.3) + 2.0
"""Highest reference of the plan, for the softest part that it allows."""


def program(retries: int) -> Program:
    segments = list(QUICK.segments)
    load = segments[LOAD]
    segments[LOAD] = replace(load, duration_s=LOAD_S, move_s=LOAD_S)
    planned = PlannedRange(
        voltages=(VoltageRange(-1.0, 4.0),), position_max_um=FURTHEST_UM, force_max_mN=LOAD_MN
    )
    return replace(
        QUICK,
        segments=tuple(segments),
        contact_stiffness_mN_per_um=K_E,
        slip_retries=retries,
        planned_range=planned,
    )


@dataclass
class Slipping:
    """An arm at a part that slips, and the outcome of its load."""

    program: Program
    limits: StepLimits
    random: Random
    slip_um: float | None
    """Distance of one slip; None: the force falls to half each time."""
    peak_mN: float = 0.0
    reach_um: float = 0.0
    """Highest reference."""
    outcome: str = ""
    slips: int = 0
    """Number of slips that the controller has detected."""

    def play(self) -> "Slipping":
        player = begin(self.program, (_estimate(0.0, 0.0, 0.0),), T)
        contact_um, free_um, zeroed, given = CONTACT_UM, 0.0, 0, 0
        kappa = S_P * K_E
        for seq in range(600):
            free_um = _free_um(player, free_um)
            x_um = free_um
            if free_um > contact_um:
                x_um = (free_um + kappa * contact_um) / (1.0 + kappa)
            force_mN = (free_um - x_um) / S_P
            self.peak_mN = max(self.peak_mN, force_mN)
            if force_mN > SLIPS_MN and (self.slip_um is None or not given):
                by_um = self.slip_um or 0.5 * force_mN / K_E * (1.0 + kappa)
                contact_um, given = contact_um + by_um, given + 1
                if free_um > contact_um:
                    x_um = (free_um + kappa * contact_um) / (1.0 + kappa)
                else:
                    x_um = free_um
            seen_um = x_um + self.random.gauss(0.0, self.limits.noise_um)
            player = advance(
                self.program,
                player,
                (_estimate(seen_um, free_um, (seq - zeroed) * T),),
                T,
                self.limits,
            )
            zeroed = seq + 1 if player.zero else zeroed
            if player.segment.presses:
                self.reach_um = max(self.reach_um, player.ref.x_um)
            if player.ended:
                break
        self.outcome, self.slips = str(player.outcome), player.slip.slips
        return self


def _free_um(player: Player, before_um: float) -> float:
    """Return the free position that the references request; it is constant while the voltage is
    frozen."""
    if player.slip.suspect is not None or player.segment.open_loop:
        return before_um
    return player.ref.x_um + (S_P * player.ref.force_mN if player.segment.presses else 0.0)


def _estimate(x_um: float, free_um: float, age_s: float) -> ArmEstimate:
    return replace(
        BLANK,
        x_um=x_um,
        force_mN=(free_um - x_um) / S_P,
        force_uncertainty_mN=0.5,
        zero_age_s=age_s,
        applied_V=free_um,
    )


def loads(slip_um: float | None, noise_um: float, retries: int, count: int) -> list[Slipping]:
    random, made = Random(SEED), program(retries)
    limits = StepLimits(noise_um, S_P, T)
    return [Slipping(made, limits, random, slip_um).play() for _ in range(count)]


@dataclass(frozen=True)
class Row:
    """Limits of one row of the table.

    A slip is detected in the first sample after it. Until then the load continues by up to 2 mN.
    """

    slip_um: float | None
    noise_um: float
    retries: int
    median_mN: float
    worst_mN: float
    found: float
    """Smallest share of loads in which the slip is detected."""


TABLE = (
    Row(1.0, 0.03, 0, 13.1, 21.5, 0.8),
    Row(3.0, 0.03, 0, 13.1, 14.0, 1.0),
    Row(10.0, 0.03, 0, 13.1, 14.0, 1.0),
    Row(None, 0.03, 0, 13.1, 14.0, 1.0),
    Row(1.0, 0.03, 1, 20.5, 21.5, 0.8),
    Row(3.0, 0.03, 1, 20.5, 22.0, 1.0),
    Row(10.0, 0.03, 1, 20.7, 22.7, 1.0),
    Row(None, 0.03, 3, 13.1, 14.0, 1.0),
    Row(3.0, 0.15, 0, 21.5, 24.0, 0.1),
    Row(10.0, 0.15, 0, 13.1, 14.0, 1.0),
    Row(None, 0.15, 3, 13.5, 14.0, 1.0),
)


def judge(row: Row, count: int) -> None:
    played = loads(row.slip_um, row.noise_um, row.retries, count)
    peaks_mN = [one.peak_mN for one in played]
    found = sum(one.slips > 0 for one in played)
    print(
        f"{row.slip_um} µm, noise {row.noise_um} µm, {row.retries} retries: peak "
        f"{median(peaks_mN):.1f} / {max(peaks_mN):.1f} mN, found {found} of {count}, "
        f"references up to {max(one.reach_um for one in played):.1f} µm, "
        f"{ {one.outcome for one in played} }"
    )
    assert median(peaks_mN) <= row.median_mN
    assert max(peaks_mN) <= row.worst_mN
    assert found >= row.found * count
    assert max(one.reach_um for one in played) <= FURTHEST_UM


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_a_part_that_slips_during_a_load_is_not_pressed_harder(row: Row) -> None:
    judge(row, FEW)


@pytest.mark.parametrize("row", TABLE, ids=str)
@pytest.mark.full
def test_over_200_loads_a_slipping_part_is_not_pressed_harder(row: Row) -> None:
    judge(row, ALL)


@pytest.mark.parametrize("noise_um", [0.03, 0.15])
def test_loads_without_a_slip_are_not_stopped(noise_um: float) -> None:
    played = loads(1e-9, noise_um, 0, FEW)
    assert {one.slips for one in played} == {0}
