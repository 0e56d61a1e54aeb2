"""Hard limits of force, following error and position, at their edges and over consecutive
samples."""

from math import nan

import pytest

from pincette.control.record import replace
from pincette.control.safety.monitors import (
    QUIET,
    UNSEEN,
    MonitorLimits,
    Watches,
    finding,
    following_excess,
    force_excess,
    position_excess,
    watch_command,
    watch_position,
)
from pincette.core.wording import cause_text, fault_text

from .bench import MONITORS, T


def found(limits: MonitorLimits, watches: Watches) -> str:
    """Return the cause of a trip as text."""
    finds = finding(limits, watches)
    return "" if finds is None else cause_text(finds.cause, (finds.fault,))


def commanded(
    watches: Watches,
    seq: int,
    *,
    x_um: float | None = 1.0,
    x_d_um: float | None = None,
    force_mN: float | None = None,
) -> Watches:
    return watch_command(MONITORS, watches, seq=seq, x_um=x_um, x_d_um=x_d_um, force_mN=force_mN)


def test_the_force_limit_is_exceeded_above_its_value_only() -> None:
    assert force_excess(MONITORS, 50.0) is None
    assert force_excess(MONITORS, -60.0) is None
    assert fault_text(force_excess(MONITORS, 50.04)) == "50.0 mN, limit 50.0 mN"
    assert fault_text(force_excess(MONITORS, 60.0)) == "60.0 mN, limit 50.0 mN"


@pytest.mark.parametrize(
    ("x_um", "x_d_um", "speed_um_per_s", "beyond"),
    [
        (3.0, 0.0, 0.0, False),
        (-3.0, 0.0, 0.0, False),
        (3.01, 0.0, 0.0, True),
        (0.0, 3.01, 0.0, True),
        (8.0, 0.0, 100.0, False),
        (8.01, 0.0, 100.0, True),
        (nan, 0.0, 0.0, True),
    ],
)
def test_the_following_bound_grows_with_the_speed(
    x_um: float, x_d_um: float, speed_um_per_s: float, beyond: bool
) -> None:
    assert bool(following_excess(MONITORS, x_um, x_d_um, speed_um_per_s)) is beyond


def test_a_following_error_is_reported_with_its_numbers() -> None:
    assert fault_text(following_excess(MONITORS, -2.0, 10.0, 20.0)) == (
        "the arm is at -2.00 µm, target 10.00 µm: off by 12.00 µm, limit 4.00 µm"
    )


@pytest.mark.parametrize(("x_um", "beyond"), [(-29.0, False), (79.0, False), (-29.01, True)])
def test_the_position_limits_are_exceeded_beyond_their_values(x_um: float, beyond: bool) -> None:
    assert bool(position_excess(MONITORS, x_um)) is beyond


def test_a_position_is_reported_with_its_limits() -> None:
    assert (
        fault_text(position_excess(MONITORS, 79.014)) == "79.01 µm, limits -29.00 µm and 79.00 µm"
    )
    assert fault_text(position_excess(MONITORS, nan)) == "nan µm, limits -29.00 µm and 79.00 µm"


def test_the_force_monitor_trips_at_the_third_sample_in_a_row() -> None:
    watches = UNSEEN
    for seq, force_mN in enumerate((51.0, 52.0, 49.0, 53.0, 54.0)):
        watches = commanded(watches, seq, force_mN=force_mN)
        assert finding(MONITORS, watches) is None
    watches = commanded(watches, 5, force_mN=55.5)
    assert found(MONITORS, watches) == "force: 55.5 mN, limit 50.0 mN, 3 samples in a row"


def test_a_sample_of_unknown_force_neither_raises_nor_lowers_the_count() -> None:
    watches = commanded(commanded(UNSEEN, 0, force_mN=60.0), 1, force_mN=60.0)
    watches = commanded(watches, 2)
    assert watches.force.count == 2
    assert found(MONITORS, commanded(watches, 3, force_mN=60.0)).startswith("force: ")


def test_the_following_error_monitor_trips_at_the_sixth_sample_in_a_row() -> None:
    watches = UNSEEN
    for seq in range(5):
        watches = commanded(watches, seq, x_um=0.0, x_d_um=4.0)
        assert finding(MONITORS, watches) is None
    caught = commanded(watches, 5, x_um=3.0, x_d_um=4.0)
    assert (caught.following.count, caught.following.newest) == (4, watches.following.newest)
    words = found(MONITORS, commanded(watches, 5, x_um=0.0, x_d_um=4.0))
    assert words.startswith("following_error: the arm is at 0.00 µm")
    assert words.endswith("6 samples in a row")


@pytest.mark.parametrize("unknown", [{"x_um": None, "x_d_um": 4.0}, {"x_um": 0.0, "x_d_um": None}])
def test_a_sample_without_target_or_position_neither_raises_nor_lowers_the_count(
    unknown: dict[str, float | None],
) -> None:
    watches = commanded(UNSEEN, 0, x_um=0.0, x_d_um=4.0)
    later = commanded(watches, 1, **unknown)
    assert later == replace(watches, seq=1)


def test_the_speed_of_the_reference_is_averaged_over_the_samples_between() -> None:
    """In two periods x_d moves by 4 µm, at 100 µm/s: the bound is 8 µm."""
    watches = commanded(UNSEEN, 3, x_um=0.0, x_d_um=0.0)
    assert commanded(watches, 5, x_um=-4.0, x_d_um=4.0).following.count == 0
    assert commanded(watches, 5, x_um=-4.1, x_d_um=4.0).following.count == 1
    assert commanded(watches, 4, x_um=-8.9, x_d_um=4.0).following.count == 0
    assert commanded(watches, 5, x_um=4.0, x_d_um=-4.0).following.count == 0
    assert commanded(watches, 5, x_um=0.0, x_d_um=4.0).aim_seq == 5
    assert pytest.approx(0.04) == 2 * T


def test_the_bound_of_the_first_reference_assumes_no_speed() -> None:
    assert commanded(UNSEEN, 0, x_um=0.0, x_d_um=3.1).following.count == 1
    assert commanded(UNSEEN, 0, x_um=0.0, x_d_um=3.0).following.count == 0


def test_each_command_is_counted_once() -> None:
    watches = commanded(UNSEEN, 4, force_mN=60.0, x_um=0.0, x_d_um=9.0)
    for seq in (4, 3, -1):
        assert commanded(watches, seq, force_mN=60.0, x_um=0.0, x_d_um=9.0) is watches


def test_the_position_monitor_trips_at_the_third_sample_in_a_row() -> None:
    watches = UNSEEN
    for x_um in (80.0, 80.0, 79.0, 80.0, 80.0):
        watches = watch_position(MONITORS, watches, x_um)
        assert finding(MONITORS, watches) is None
    words = found(MONITORS, watch_position(MONITORS, watches, 80.0))
    expected = "position: 80.00 µm, limits -29.00 µm and 79.00 µm, 3 samples in a row"
    assert words == expected


def test_a_position_within_its_limits_leaves_the_monitors_unchanged() -> None:
    assert watch_position(MONITORS, UNSEEN, 1.0) is UNSEEN


def test_of_several_faults_the_force_limit_takes_precedence() -> None:
    watches = UNSEEN
    for seq in range(6):
        watches = watch_position(MONITORS, watches, 90.0)
        watches = commanded(watches, seq, x_um=90.0, x_d_um=0.0, force_mN=90.0)
    assert found(MONITORS, watches).startswith("force: ")
    watches = commanded(watches, 6, x_um=90.0, x_d_um=0.0, force_mN=0.0)
    assert found(MONITORS, watches).startswith("position: ")
    watches = watch_position(MONITORS, watches, 0.0)
    assert found(MONITORS, watches).startswith("following_error: ")


FASTEST = replace(MONITORS, fastest_um_per_s=40.0)


def test_an_oscillating_reference_does_not_widen_the_bound_beyond_what_the_arm_can_move() -> None:
    """By 20 µm each sample, 1000 µm/s: it would be credited 50 µm, and the arm stands still."""
    watches = UNSEEN
    for seq in range(6):
        aim_um = 10.0 if seq % 2 else -10.0
        watches = watch_command(FASTEST, watches, seq=seq, x_um=0.0, x_d_um=aim_um, force_mN=None)
    assert found(FASTEST, watches).startswith("following_error: ")
    assert following_excess(FASTEST, 0.0, 5.0, 1000.0) is None
    assert following_excess(FASTEST, 0.0, 5.01, 1000.0) is not None


def test_a_target_that_is_reached_only_intermittently_is_detected_too() -> None:
    watches = UNSEEN
    for seq in range(12):
        watches = commanded(watches, seq, x_um=4.0 if seq % 4 == 3 else 0.0, x_d_um=4.0)
    assert found(MONITORS, watches).startswith("following_error: ")
    for seq in range(12, 30):
        watches = commanded(watches, seq, x_um=4.0, x_d_um=4.0)
    assert watches.following == QUIET
