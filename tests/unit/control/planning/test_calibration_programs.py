"""Programs of the calibrations: their motions, limits and refusals."""

from dataclasses import replace
from itertools import pairwise

import pytest

from pincette.control.planning.calibration_programs import (
    compliance_program,
    frequency_response_program,
    full_cycles,
    noise_program,
)
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.contact_stiffness_program import (
    LEVELS_V,
    SETTLING_CYCLES,
    STEP_V,
    TROUGH_MN,
    contact_stiffness_program,
    crest_force_mN,
    levels_within,
)
from pincette.control.planning.free_response_program import cycles_mean_V, free_response_program
from pincette.control.planning.path_shapes import KNOTS_MAX, peaks
from pincette.control.planning.program import Program, Segment
from pincette.control.planning.segments import Drive, PlayedSweep, Press, paths_of
from pincette.control.response.hysteresis import HysteresisModel

from .bench import CONTACT, LIMITS, RIG

ROOMY = replace(
    RIG, limits=replace(LIMITS, force_max_mN=60.0, voltage_max_V=4.5, position_max_um=90.0)
)
PERIOD_S = 0.02

REQUEST = ContactRequest(**CONTACT | {"stiffness_mN_per_um": 2.17})


def voltages(program: Program, segments: tuple[Segment, ...] | None = None) -> list[float]:
    """Return every voltage of the open-loop segments, from 0 V on."""
    found, held_V = [0.0], 0.0
    for segment in segments or program.segments:
        assert segment.open_loop
        assert segment.duration_s is not None
        begin_V = held_V
        for path in paths_of(segment):
            for index in range(1, round(segment.duration_s / PERIOD_S) + 1):
                held_V = path.at(index * PERIOD_S) + (begin_V if path.relative else 0.0)
                found.append(held_V)
    return found


def test_noise_is_read_at_rest() -> None:
    (segment,) = noise_program().segments
    assert segment == Drive("noise", 8.0, guarded=True)


def test_each_weight_has_a_wait_a_settling_time_and_a_measurement() -> None:
    program = compliance_program(RIG, (0.0, 5.0, 10.0))
    assert [segment.phase for segment in program.segments[:4]] == [
        "hang 1",
        "settle 1",
        "measure 1",
        "hang 2",
    ]
    assert len(program.segments) == 15
    waits = [segment.duration_s is None for segment in program.segments]
    assert waits == [True, False, False] * 5
    assert all(isinstance(segment, Drive) for segment in program.segments)


def test_a_weight_that_bends_the_arm_too_far_is_refused() -> None:
    with pytest.raises(ValueError, match=r"weight = 41\.000 mN, limits 0 mN to 40 mN"):
        compliance_program(RIG, (0.0, 41.0))
    short = replace(RIG, limits=replace(LIMITS, position_min_um=-5.0))
    with pytest.raises(ValueError, match=r"under 20 mN = -9\.200 µm, limits -5 µm to 70 µm"):
        compliance_program(short, (0.0, 20.0))


def test_a_sweep_is_captured_between_two_rests_after_its_range_was_probed() -> None:
    program = frequency_response_program(RIG, amplitude_V=0.05, damping_ratio=0.026)
    assert [segment.phase for segment in program.segments] == ["feel", "rest", "sweep", "rest"]
    assert [segment.guarded for segment in program.segments] == [True, True, False, True]
    (felt,) = paths_of(program.segments[0])
    # Twice the swing at resonance, and slowly.
    assert max(knot.value for knot in felt.knots) == pytest.approx(2.0 * 0.05 / (2.0 * 0.026))
    assert felt.duration_s > 4.0 * 0.05 / (2.0 * 0.026) * 19.0 / 20.0
    played = program.segments[2]
    assert isinstance(played, PlayedSweep)
    sweep = played.sweep
    assert (sweep.from_hz, sweep.to_hz, sweep.amplitude_V) == (5.0, 800.0, 0.05)
    assert program.capture_hz == sweep.rate_hz == 10_000.0


@pytest.mark.parametrize(
    ("amplitude_V", "rate_hz", "rest_V", "text"),
    [
        (0.1, 10_000.0, 0.0, r"resonance of a sweep of 0\.1 V = -36\.538 µm, limits -20 µm"),
        (0.05, 5000.0, 0.0, "capture at 5000 Hz, must be at least 10000 Hz"),
        (0.05, 10_000.0, 3.99, r"voltage of the sweep = 4\.040 V, limits -1 V to 4 V"),
        (-0.05, 10_000.0, 0.0, "amplitude of the sweep = -0.05 V"),
    ],
)
def test_an_impossible_sweep_is_refused(
    amplitude_V: float, rate_hz: float, rest_V: float, text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        frequency_response_program(
            RIG, amplitude_V=amplitude_V, damping_ratio=0.026, rate_hz=rate_hz, rest_V=rest_V
        )


def test_the_free_motion_covers_the_range_within_the_limits() -> None:
    program = free_response_program(RIG, from_V=-0.3, to_V=3.5, rate_V_per_s=3.2)
    put_out = voltages(program)
    assert (min(put_out), max(put_out)) == pytest.approx((-1.0, 3.5), abs=1e-9)
    assert put_out[-1] == pytest.approx(0.0)
    steps = [abs(after - before) for before, after in pairwise(put_out)]
    assert max(steps) <= LIMITS.slew_V_per_s * PERIOD_S * (1.0 + 1e-6)
    for segment in program.segments:
        assert all(len(path.knots) <= KNOTS_MAX for path in paths_of(segment))
    (cycles,) = paths_of(next(one for one in program.segments if one.phase == "cycles"))
    assert (peaks(cycles).lowest, peaks(cycles).highest) == pytest.approx((-1.0, 1.0), abs=1e-3)


def test_the_cycles_are_shifted_if_the_limits_require_it() -> None:
    assert cycles_mean_V(RIG) == 0.0
    assert cycles_mean_V(replace(RIG, limits=replace(LIMITS, voltage_min_V=0.0))) == 1.0
    stiff = replace(RIG, piezo_um_per_V=25.0)
    assert cycles_mean_V(stiff) == pytest.approx(1.0 - 20.0 / 25.0)
    narrow = replace(RIG, limits=replace(LIMITS, voltage_max_V=0.9))
    with pytest.raises(ValueError, match=r"2 V peak to peak, limits -1\.000 V to 0\.900 V"):
        cycles_mean_V(narrow)


@pytest.mark.parametrize(
    ("from_V", "to_V", "rate", "text"),
    [
        (-0.3, 4.2, 3.2, r"voltage of the free motion = 4\.200 V, limits -1 V to 4 V"),
        (-0.3, 3.9, 3.2, r"position at 3\.9 V = 74\.100 µm, limits -20 µm to 70 µm"),
        (-0.3, 3.5, 11.0, r"rate of the free motion = 11\.000 V/s, limits 0 V/s to 10 V/s"),
        (1.0, 1.0, 3.2, "range of the free motion = 0.0 V"),
        (float("nan"), 1.0, 3.2, "must be finite"),
    ],
)
def test_a_free_motion_beyond_the_limits_is_refused(
    from_V: float, to_V: float, rate: float, text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        free_response_program(RIG, from_V=from_V, to_V=to_V, rate_V_per_s=rate)


def test_the_evaluated_cycles_are_whole_and_have_full_amplitude() -> None:
    program = contact_stiffness_program(REQUEST, ROOMY)
    (path,) = paths_of(next(each for each in program.segments if each.phase == "level 4"))
    found = full_cycles(path, PERIOD_S, 4)
    assert found == slice(300, 700)
    assert path.at(found.start * PERIOD_S) == pytest.approx(0.0, abs=1e-9)
    assert max(path.at(k * PERIOD_S) for k in range(300, 700)) == pytest.approx(1.0)
    assert path.cycles == SETTLING_CYCLES + 4
    with pytest.raises(ValueError, match="7 cycles of 6 at full amplitude"):
        full_cycles(path, PERIOD_S, 7)


def test_the_widest_level_is_first_and_peaks_at_the_voltage_found_by_the_law() -> None:
    program = contact_stiffness_program(REQUEST, ROOMY)
    phases = [segment.phase for segment in program.segments]
    assert phases == [
        *("zero", "approach", "approach", "contact", "load", "load", "press", "mean"),
        *("level 4", "level 3", "level 2", "level 1", "unload", "retreat"),
    ]
    put_out = voltages(program, program.segments[7:13])
    assert max(put_out) == pytest.approx(0.0, abs=1e-9)
    assert min(put_out) == pytest.approx(-2.0, abs=1e-3)
    press = program.segments[6]
    assert isinstance(press, Press)
    assert press.to_mN == pytest.approx(crest_force_mN(REQUEST, ROOMY, 2.0))
    assert program.guards.stiffness_min_mN_per_um < 0.5 * REQUEST.stiffness_mN_per_um


def test_the_force_of_a_press_includes_the_swings_of_the_identified_arm() -> None:
    # The swings of this arm at a pressed part are half as wide again as d_p predicts.
    wide = HysteresisModel((0.0, 0.5), (28.5, 5.0))
    line_mN = crest_force_mN(REQUEST, ROOMY, 2.0)
    crest_mN = crest_force_mN(REQUEST, replace(ROOMY, free_response=wide), 2.0)
    series = 0.46 + 1.0 / REQUEST.hardest_mN_per_um
    assert crest_mN - TROUGH_MN == pytest.approx((2.0 * 33.5 - 2.0 * 0.5 * 5.0) / series, rel=0.05)
    assert crest_mN > 1.4 * line_mN
    narrow = HysteresisModel((0.0, 0.5), (9.0, 1.0))
    assert crest_force_mN(REQUEST, replace(ROOMY, free_response=narrow), 2.0) == line_mN


def test_levels_beyond_the_limits_are_refused_and_lower_ones_are_proposed() -> None:
    with pytest.raises(ValueError, match=r"2 V peak to peak: force 57\.\d+ mN above the limit 40"):
        contact_stiffness_program(REQUEST, RIG)
    levels = levels_within(REQUEST, RIG)
    assert 1.2 < levels[-1] < 1.6
    ratios = [found / requested for found, requested in zip(levels, LEVELS_V, strict=True)]
    assert ratios == pytest.approx([ratios[0]] * 4, rel=5e-3)
    assert contact_stiffness_program(REQUEST, RIG, levels).segments
    wider = tuple([level_V * (levels[-1] + STEP_V) / levels[-1] for level_V in levels])
    with pytest.raises(ValueError, match="above the limit 40"):  # the widest that fits was found
        contact_stiffness_program(REQUEST, RIG, wider)
    assert levels_within(REQUEST, ROOMY) == LEVELS_V
    weak = replace(RIG, limits=replace(LIMITS, force_max_mN=12.0))
    with pytest.raises(ValueError, match=r"0\.50 V peak to peak: force"):
        levels_within(REQUEST, weak)
    with pytest.raises(ValueError, match="2 levels of voltage, must be at least 3"):
        contact_stiffness_program(REQUEST, ROOMY, (1.0, 2.0))
    with pytest.raises(ValueError, match=r"level of voltage = -1\.0 V"):
        contact_stiffness_program(REQUEST, ROOMY, (-1.0, 1.0, 2.0))
