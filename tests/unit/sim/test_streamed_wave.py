import math

import pytest

from pincette.config import Simulation
from pincette.sim.rig.rig import SimulatedRig

PERIOD_S, RATE_HZ, PER_TICK = 0.02, 7000.0, 140
WAVE_V = [0.3 * math.sin(0.02 * index) for index in range(6 * PER_TICK)]
Played = tuple[list[float], list[float]]


def clock() -> float:
    return 0.0


def played_whole(simulation: Simulation) -> Played:
    rig = SimulatedRig(simulation, PERIOD_S, True, clock)
    rig.begin_capture(RATE_HZ)
    rig.put_out_wave(WAVE_V, RATE_HZ)
    for _ in range(8):
        rig.go_on()
    return rig.drain()


def played_in_pieces(simulation: Simulation, ahead: int) -> Played:
    rig = SimulatedRig(simulation, PERIOD_S, True, clock)
    rig.begin_capture(RATE_HZ)
    rig.put_out_wave(WAVE_V[:ahead], RATE_HZ)
    for begin in range(ahead, len(WAVE_V), PER_TICK):
        rig.extend_wave(WAVE_V[begin : begin + PER_TICK])
        rig.go_on()
    while rig.now_s() < 8.5 * PERIOD_S:
        rig.go_on()
    return rig.drain()


@pytest.mark.parametrize("ahead", [PER_TICK, 3 * PER_TICK])
def test_a_wave_written_in_pieces_gives_the_same_bits(simulation: Simulation, ahead: int) -> None:
    whole, pieces = played_whole(simulation), played_in_pieces(simulation, ahead)
    assert len(whole[0]) == 9 * PER_TICK
    assert pieces == whole
    assert max(map(abs, whole[1])) > 0.2


def test_a_wave_uses_the_clock_of_the_capture(simulation: Simulation) -> None:
    now_s = [100.0]
    quick = {"output_lag_s": 0.0, "output_step_V": 1e-6}
    rig = SimulatedRig(simulation.model_copy(update=quick), PERIOD_S, False, lambda: now_s[0])
    rig.begin_capture(1000.0)
    now_s[0] = 100.0104
    rig.put_out_wave([1.0, 0.5, 0.25], 1000.0)
    at_V = list[float]()
    for at_s in (100.0109, 100.0119, 100.0121, 100.0129, 100.0131):
        now_s[0] = at_s
        at_V.append(rig.snapshot().voltage_V)
    assert at_V == [1.0, 1.0, 0.5, 0.5, 0.25]
    assert not rig.wave_over
    now_s[0] = 100.0141
    assert rig.wave_over


def test_after_a_buffer_underrun_a_waveform_has_ended_and_accepts_no_more_data(
    simulation: Simulation,
) -> None:
    rig = SimulatedRig(simulation, PERIOD_S, True, clock)
    rig.put_out_wave(WAVE_V[:PER_TICK], RATE_HZ)
    assert not rig.wave_over
    rig.go_on()
    assert rig.wave_over
    with pytest.raises(ValueError, match="the wave has ended"):
        rig.extend_wave([0.0])


@pytest.mark.parametrize("voltages_V", [[], [0.0, math.nan]])
def test_an_invalid_wave_is_refused_without_effect(
    simulation: Simulation, voltages_V: list[float]
) -> None:
    rig = SimulatedRig(simulation, PERIOD_S, True, clock)
    with pytest.raises(ValueError, match="finite"):
        rig.put_out_wave(voltages_V, RATE_HZ)
    assert rig.now_s() == 0.0
    rig.put_out_wave([0.0, 1.0, 1.0] * PER_TICK, RATE_HZ)
    with pytest.raises(ValueError, match="finite"):
        rig.extend_wave(voltages_V)
