"""The rig of the paper's experiments, and the random rigs around it."""

from functools import lru_cache
from itertools import pairwise

import pytest

from pincette.config import RigFile
from pincette_study import printed
from pincette_study.open_loop import Motion, drive, peak_to_peak, raised_sinusoid
from pincette_study.rigs import (
    CONTACT_STIFFNESS,
    Draw,
    frozen_rig,
    hysteresis_for_loop,
    loop_percent,
    random_rig,
    simulation_of,
)
from tests.support.rigs import demo_rig

BASE = demo_rig()
SEEDS = (1, 2)


@lru_cache
def drawn(seed: int) -> tuple[RigFile, Draw]:
    return random_rig(BASE, seed)


@lru_cache
def frozen() -> RigFile:
    return frozen_rig(BASE)


def free_cycle(rig: RigFile) -> Motion:
    """Return the settled cycle of the free arm at 2 V peak to peak."""
    free = simulation_of(rig).model_copy(update={"bead": False})
    return drive(free, raised_sinusoid(2.0, 0.5, 4, 0.02), 0.02).tail(100)


def gain_um_per_V(rig: RigFile) -> float:
    cycle = free_cycle(rig)
    return peak_to_peak(cycle.true_x_um) / peak_to_peak(cycle.voltage_V)


def test_the_contact_has_the_values_of_figure_7() -> None:
    # At the peak 16 mN at 7.45 µm; planned were 20 mN at 8.45 µm.
    assert pytest.approx(16.0 / 7.45) == CONTACT_STIFFNESS
    assert simulation_of(frozen()).environment_stiffness_mN_per_um == CONTACT_STIFFNESS


def test_the_stored_rig_has_the_values_printed_in_the_paper() -> None:
    simulation = simulation_of(frozen())
    omega_n, zeta = simulation.natural_frequency_rad_per_s, simulation.damping_ratio
    assert omega_n**2 == pytest.approx(5.943e6)
    assert 2.0 * zeta * omega_n == pytest.approx(126.8)
    assert simulation.compliance_um_per_mN == pytest.approx(0.46)
    assert gain_um_per_V(frozen()) == pytest.approx(19.0, rel=1e-3)
    assert (frozen().rig.period_s, frozen().lockstep) == (0.02, True)


def test_values_that_the_paper_does_not_print_come_from_the_base_rig() -> None:
    here, there = simulation_of(frozen()), simulation_of(BASE)
    assert here.hysteresis == there.hysteresis
    assert here.creep_per_decade == there.creep_per_decade
    assert here.sensor_noise_um == there.sensor_noise_um
    assert frozen().part == BASE.part
    assert frozen().model == BASE.model


@pytest.mark.parametrize("seed", SEEDS)
def test_a_randomly_drawn_rig_has_the_drawn_values(seed: int) -> None:
    rig, draw = drawn(seed)
    simulation = simulation_of(rig)
    assert draw.seed == simulation.seed == seed
    assert simulation.environment_stiffness_mN_per_um == draw.stiffness_mN_per_um
    assert simulation.creep_per_decade == pytest.approx(draw.creep_percent_per_decade / 100.0)
    assert loop_percent(simulation) == pytest.approx(draw.loop_percent, abs=0.3)
    assert gain_um_per_V(rig) == pytest.approx(printed.PIEZO_UM_PER_V, rel=1e-3)
    assert 0.8 <= draw.stiffness_mN_per_um / CONTACT_STIFFNESS <= 1.2
    assert 10.0 <= draw.loop_percent <= 23.0
    assert 1.0 <= draw.creep_percent_per_decade <= 2.0


def test_a_seed_determines_a_rig() -> None:
    rig, draw = random_rig(BASE, SEEDS[0])
    assert (rig, draw) == drawn(SEEDS[0])
    other, other_draw = drawn(SEEDS[1])
    for name in ("stiffness_mN_per_um", "loop_percent", "creep_percent_per_decade"):
        assert getattr(draw, name) != getattr(other_draw, name)
    assert rig.model == other.model == BASE.model


def test_the_width_of_the_loop_is_correct() -> None:
    rig = frozen()
    cycle = free_cycle(rig)
    stroke_um = peak_to_peak(cycle.true_x_um)
    # Largest width, from rising and falling samples of about the same voltage.
    rows = sorted(zip(cycle.voltage_V.tolist(), cycle.true_x_um.tolist(), strict=True))
    widest_um = max(abs(x - y) for (u, x), (v, y) in pairwise(rows) if abs(u - v) < 2e-3)
    found = loop_percent(simulation_of(rig))
    assert found == pytest.approx(100.0 * widest_um / stroke_um, abs=0.3)
    straight = simulation_of(rig).bouc_wen.model_copy(update={"A_over_d": 0.0})
    bare = {"hysteresis": straight, "creep_per_decade": 0.0, "output_lag_s": 0.0}
    assert abs(loop_percent(simulation_of(rig).model_copy(update=bare))) < 0.5


@pytest.mark.parametrize("percent", [10.0, 23.0])
def test_the_limits_of_the_random_draw_can_be_reached(percent: float) -> None:
    simulation = simulation_of(frozen())
    share = hysteresis_for_loop(simulation, percent)
    shape = simulation.bouc_wen.model_copy(update={"A_over_d": share})
    found = loop_percent(simulation.model_copy(update={"hysteresis": shape}))
    assert found == pytest.approx(percent, abs=0.3)


def test_a_rig_file_without_simulation_is_refused() -> None:
    bare = BASE.model_copy(update={"simulation": None})
    for make in (simulation_of, frozen_rig):
        with pytest.raises(ValueError, match=r"has no \[simulation\]"):
            make(bare)
