"""Sequence numbers that may come next."""

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from pincette.core.messages import Command, Position, Sample
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.engine.joiner import AHEAD, Joiner
from pincette_estimator import SERVICE
from tests.unit.engine import samples

T = 0.02
POSITION = replace(samples.POSITION, epoch=3)
COMMAND = Command(3, 0, 1, (ArmCommand(0.5),), False, False, False, True)
ESTIMATE = replace(samples.ESTIMATE, epoch=3)


def fresh() -> Joiner:
    return Joiner(SERVICE, T, lockstep=False)


def begun(epoch: int = 3, now: float = 100.0) -> Joiner:
    joiner = fresh()
    joiner.begin(epoch, now)
    return joiner


def numbered(sample: Sample, seq: int) -> Sample:
    return replace(sample, seq=seq)


@given(st.lists(st.integers(-2, 40), max_size=60))
def test_samples_that_arrive_out_of_order_are_not_used(seqs: list[int]) -> None:
    joiner = begun()
    taken = [seq for seq in seqs if joiner.admits(numbered(POSITION, seq), 101.0)]
    in_order: list[int] = []
    for seq in seqs:
        if seq > max(in_order, default=-1):
            in_order.append(seq)
    assert taken == in_order


def test_each_topic_has_its_own_numbers() -> None:
    joiner = begun()
    assert joiner.admits(numbered(POSITION, 9), 101.0)
    assert joiner.admits(numbered(ESTIMATE, 3), 101.0)
    assert not joiner.admits(numbered(ESTIMATE, 3), 101.0)


def test_an_older_command_is_passed_on_to_the_actuator() -> None:
    joiner = begun()
    for seq in (5, 5, 4, -1):
        assert joiner.admits(numbered(COMMAND, seq), 101.0)


def test_a_sample_newer_than_the_time_grid_allows_is_not_used() -> None:
    for sample in (POSITION, ESTIMATE, COMMAND):
        most = AHEAD + 50
        assert not begun().admits(numbered(sample, most + 1), 101.0)
        assert begun().admits(numbered(sample, most), 101.0)
        joiner = begun()
        assert not joiner.admits(numbered(sample, 2**63), 101.0)
        assert joiner.admits(numbered(sample, 12), 101.0), (
            "a wrong clock of one program must not exclude others"
        )


def test_a_clock_that_is_slower_than_that_of_the_sensor_is_tolerated_for_a_year() -> None:
    joiner = begun(now=0.0)
    for day in range(1, 400):
        now = 86_400.0 * day
        assert joiner.admits(numbered(POSITION, round(now * (1.0 + 2e-4) / T)), now)


def test_samples_of_another_epoch_or_of_the_idle_loop_are_not_checked() -> None:
    joiner = begun()
    other = replace(POSITION, epoch=4, seq=-7)
    assert joiner.admits(other, 101.0)
    assert joiner.admits(other, 101.0)
    idle = fresh()
    for seq in (900, 0, 0):
        assert idle.admits(Position(0, seq, 0.0, (ArmPosition(1.0, valid=True),)), 0.0)


def test_a_new_epoch_starts_without_sequence_numbers() -> None:
    joiner = begun()
    assert joiner.admits(numbered(POSITION, 40), 101.0)
    joiner.begin(5, 102.0)
    assert joiner.admits(replace(POSITION, epoch=5), 102.0)
    twin = joiner.copy()
    assert not twin.admits(replace(POSITION, epoch=5), 102.0)
    assert twin.admits(replace(POSITION, epoch=5, seq=1), 102.0)
    assert joiner.admits(replace(POSITION, epoch=5, seq=1), 102.0)
