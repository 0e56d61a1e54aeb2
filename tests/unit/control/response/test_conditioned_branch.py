"""Conditioning strokes are recognised in the voltage; the paths of a conditioned arm are
compared."""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from pincette.control.response.branch_fit import ConditionedWay, measured_branch
from pincette.control.response.conditioned_branch import (
    STROKES,
    ConditionedBranch,
    Strokes,
    past_creep_mN,
    strokes_needed,
)
from pincette.control.response.error_growth import ErrorGrowth
from pincette.control.response.free_response import FreeSample
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column, simulate
from pincette.control.response.identified_response import IdentifiedResponse, identified_response
from pincette.control.response.model_errors import RehearsedGrip
from pincette.control.response.poled import poled
from pincette.control.response.stroke_check import (
    Base,
    Bottom,
    MeasurementErrors,
    StrokeChange,
    corrected,
    rest_base,
    stroke_change,
)

LOW_V = -1.0
BRANCH = ConditionedBranch((LOW_V, 0.0, 2.0), (0.0, 0.2, -0.4), ErrorGrowth((1.0,), (0.05,)))
MODEL = HysteresisModel((0.0, 0.3), (15.0, 4.0))
TICK_S = 0.02
NOISE_UM = 0.03
REST = 10


def voltages(*stops_V: float) -> list[float]:
    """Return voltages in steps of 0.05 V, with a rest of 15 ticks at each stop."""
    at_V, found = 0.0, list[float]()
    for stop_V in stops_V:
        steps = max(1, round(abs(stop_V - at_V) / 0.05))
        found += [at_V + (stop_V - at_V) * step / steps for step in range(1, steps + 1)]
        found += [stop_V] * 15
        at_V = stop_V
    return found


STROKED = voltages(*(LOW_V, 0.0) * STROKES)


def followed(*runs_V: list[float]) -> Strokes:
    strokes = Strokes()
    for run_V in runs_V:
        for voltage_V in run_V:
            strokes = strokes.updated(BRANCH, voltage_V, TICK_S)
    return strokes


@pytest.mark.parametrize(
    ("stops_V", "conditioned"),
    [
        ((LOW_V, 0.0) * 3, True),
        ((LOW_V, 0.0) * 2, False),
        ((LOW_V, 0.0) * 5, True),
        ((0.9 * LOW_V, 0.0) * 3, False),
        ((LOW_V, 0.0, LOW_V, 0.3, LOW_V, 0.0), False),
        ((LOW_V, -0.5, LOW_V, -0.5, LOW_V, 0.0), False),
    ],
)
def test_consecutive_full_strokes_condition_the_arm(
    stops_V: tuple[float, ...], *, conditioned: bool
) -> None:
    assert followed(voltages(*stops_V)).conditioned is conditioned


def test_after_a_grip_a_single_stroke_does_not_restore_the_conditioned_branch() -> None:
    rising = followed(STROKED, voltages(0.0, 1.5)[15:])
    assert rising.fresh
    assert rising.added_um == pytest.approx(BRANCH.at(1.5))
    back = followed(STROKED, voltages(0.0, 1.5, 0.0)[15:])
    assert back.conditioned
    assert not back.fresh
    assert back.added_um == rising.added_um
    once = followed(STROKED, voltages(0.0, 1.5, 0.0, LOW_V, 0.0)[15:])
    assert not once.conditioned
    assert once.added_um == rising.added_um


def test_shallow_strokes_are_repeated_more_often() -> None:
    assert strokes_needed(-2.0, 2.0) == STROKES
    assert strokes_needed(-0.5, 2.5) > strokes_needed(-1.0, 2.5) > STROKES


def test_the_corrected_ratio_of_a_motion_is_most_accurate_at_the_measured_voltages() -> None:
    branch = replace(
        BRANCH, places_V=(1.0, 1.4), way_ratios=(1.0, 1.02), way_spread=0.001, way_uneven=0.005
    )
    assert branch.way_at(1.0) == pytest.approx((1.0, 0.001))
    assert branch.way_at(1.4) == pytest.approx((1.02, 0.001))
    assert branch.way_at(1.2) == pytest.approx((1.01, hypot(0.001, 0.01, 0.005)))
    assert branch.way_at(0.5) == pytest.approx((1.0, hypot(0.001, 0.02, 0.005)))
    assert branch.way_at(1.42)[1] < branch.way_at(2.0)[1]
    assert BRANCH.way_at(1.0) == (1.0, 0.0)


def test_creep_continues_from_a_rest_at_a_higher_voltage_after_a_grip() -> None:
    model = HysteresisModel((0.0, 0.3), (15.0, 4.0), (2.0,), (0.01,))
    below, above = poled(model, (LOW_V, 2.0)), poled(model, (LOW_V, 2.0), from_above=True)
    assert above.plays_V == below.plays_V
    assert above.static_um == below.static_um
    assert above.creep_um[0] > below.creep_um[0]


def test_creep_of_the_past_decays() -> None:
    creep_mN = [past_creep_mN(since_s) for since_s in (0.0, 2.0, 10.0, 60.0, 3600.0)]
    assert creep_mN == pytest.approx([0.13, 0.13, 0.07, 0.03, 0.03])


REST_V, REST_TICKS = 0.0, 25


class Way(NamedTuple):
    """A response after strokes and a rise, with the start of its paths and its last rest."""

    response: IdentifiedResponse
    bottom: Base
    base: Base
    rest: FreeSample


def conditioned_way(gain: float, to_V: float = 1.5, pressed_um: float = 0.0) -> Way:
    """Return the paths of an arm with another gain; at the end a part may press it back."""
    response, bottom = identified_response(MODEL, 19.0, 0.1, branch=BRANCH), Bottom()
    base: Base | None = None
    rest = response.sample(0.0)
    rise_V = voltages(0.0, to_V)[15:]
    for voltage_V in [*STROKED, *[REST_V] * REST_TICKS, *rise_V]:
        if voltage_V > REST_V and base is None:
            base = rest_base(response, rest, REST)
        response = response.updated(voltage_V, TICK_S)
        x_um = 3.0 + gain * response.calibrated_um() - (pressed_um if voltage_V > REST_V else 0.0)
        if response.strokes.bottom:
            bottom = bottom.updated(response, x_um)
        rest = response.sample(x_um)
    assert base is not None
    return Way(response, bottom.base, base, rest)


def change_of(way: Way, **doubts: float) -> StrokeChange | None:
    """Compare the path from the rest after the strokes."""
    doubt = MeasurementErrors(**{"noise_um": NOISE_UM, **doubts})
    return stroke_change(way.response, way.base, way.rest, REST, doubt)


@pytest.mark.parametrize("gain", [0.95, 0.97, 0.99, 1.0, 1.01, 1.03, 1.05])
def test_a_changed_stroke_is_found_and_corrected(gain: float) -> None:
    way = conditioned_way(gain)
    found = change_of(way)
    assert found is not None
    assert found.change == pytest.approx(gain - 1.0, abs=1e-9)
    assert found.significant is (gain != 1.0)
    assert 0.0039 <= found.limit < 0.007
    after = corrected(way.response, found)
    assert after.factor == pytest.approx(gain)
    assert after.position_um() == pytest.approx(way.response.position_um())
    again = change_of(way._replace(response=after, rest=after.sample(way.rest.x_um)))
    assert again is not None
    assert again.change == pytest.approx(gain - 1.0, abs=1e-9)
    assert corrected(after, again) is after


def test_too_large_a_change_is_refused() -> None:
    for gain, refused in ((1.04, False), (0.96, False), (1.06, True), (0.94, True)):
        found = change_of(conditioned_way(gain))
        assert found is not None
        assert found.refused is refused


def test_the_limit_allows_for_noise_drift_and_creep_of_the_past() -> None:
    way = conditioned_way(1.0)
    plain = change_of(way, noise_um=0.0)
    assert plain is not None
    assert plain.limit == pytest.approx(0.0039)
    length_um = plain.way_um
    for doubts, more in (
        ({"drift_um_per_s": 0.02}, 0.02 * (way.response.strokes.since_s - way.base.since_s)),
        ({"unknown_um": 0.5}, 0.0),
    ):
        found = change_of(way, noise_um=0.0, **doubts)
        assert found is not None
        assert found.limit == pytest.approx(plain.limit + more / length_um)
    for doubts in ({"noise_um": 0.15}, {"noise_um": 0.0, "past_um": 0.03}):
        found = change_of(way, **doubts)
        assert found is not None
        assert plain.limit < found.limit < 0.03


def test_a_motion_is_not_compared_if_drift_history_or_shortness_make_it_inaccurate() -> None:
    assert change_of(conditioned_way(1.03), drift_um_per_s=2.0) is None
    assert change_of(conditioned_way(1.03), past_um=1.0) is None
    assert change_of(conditioned_way(1.03, to_V=0.2)) is None


def test_the_change_of_the_stroke_is_evaluated_only_at_the_rest_after_the_strokes() -> None:
    way = conditioned_way(1.04)
    doubt = MeasurementErrors(0.0)
    assert stroke_change(way.response, way.bottom, way.rest, REST, doubt) is None
    response, bottom = identified_response(MODEL, 19.0, 0.1, branch=BRANCH), Bottom()
    for voltage_V in [*STROKED, *[REST_V] * REST_TICKS]:
        response = response.updated(voltage_V, TICK_S)
        if response.strokes.bottom:
            bottom = bottom.updated(response, 1.04 * response.calibrated_um())
    rest = response.sample(1.04 * response.calibrated_um())
    found = stroke_change(response, bottom.base, rest, REST, doubt)
    assert found is not None
    assert found.change == pytest.approx(0.04, abs=1e-9)
    unsure = stroke_change(
        response, bottom.base, rest, REST, MeasurementErrors(0.0, unknown_um=0.5)
    )
    assert unsure is None or unsure.limit > found.limit + 0.02


def test_an_arm_without_strokes_is_not_compared() -> None:
    response = identified_response(MODEL, 19.0, 0.1, branch=BRANCH)
    rest = response.sample(0.0)
    assert rest_base(response, rest, REST) is None
    assert (
        stroke_change(response, Base(0.0, 0.0, REST, 0.0), rest, REST, MeasurementErrors(0.0))
        is None
    )


def test_the_error_of_the_return_is_taken_from_rehearsed_grips_after_strokes() -> None:
    """The rehearsals without strokes left 0.12 µm on a relay arm, those after them 0.27 µm."""
    voltages_V, wrong_um = [0.0], [0.0]
    ways: list[ConditionedWay] = []

    def to(*stops_V: float, more_um: float = 0.0) -> slice:
        begin = len(voltages_V)
        for stop_V in stops_V:
            leg_V = np.linspace(voltages_V[-1], stop_V, 21)[1:]
            voltages_V.extend([*leg_V.tolist(), *[stop_V] * 2 * REST])
            wrong_um.extend([more_um] * (20 + 2 * REST))
        return slice(begin, len(voltages_V))

    for _ in range(2):
        strokes, stairs = to(*[LOW_V, 0.0] * 3), to(0.5, 1.0, 1.5, 2.0)
        ways.append(ConditionedWay(strokes, stairs, None))
        to(0.0)
    for error_um in (0.3, -0.4):
        strokes, approach, press = to(*[LOW_V, 0.0] * 3), to(1.0), to(1.6)
        let_go = to(0.0, more_um=error_um)
        ways.append(ConditionedWay(strokes, None, RehearsedGrip(approach, press, let_go=let_go)))
    u: Column = np.array(voltages_V)
    line = HysteresisModel((0.0,), (20.0,))
    found = measured_branch(line, u, simulate(line, u, TICK_S) + np.array(wrong_um), TICK_S, ways)
    assert found is not None
    assert found.return_error_um == pytest.approx(sqrt((0.3**2 + 0.4**2) / 2.0), rel=0.01)
    assert max(found.branch.errors.errors_um) < 0.01
