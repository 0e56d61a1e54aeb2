"""Samples joined as they arrive: in order, each once, bounded, whatever the bus does to them."""

import asyncio
from collections.abc import Iterable
from itertools import pairwise
from math import ceil

import pytest
from msgspec.structs import replace
from pydantic import ValidationError

from pincette.api.live import LiveBatch
from pincette.bus.memory import MemoryBus
from pincette.core.faults import FaultCode, fault
from pincette.core.messages import Estimate, Message, Position, Telemetry
from pincette.core.messages.arms import ArmApplied, ArmPosition
from pincette.core.topics import APPLIED, ESTIMATE, POSITION, TELEMETRY
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.rigs.live import (
    EARLY_MOST,
    EVENT_POINTS,
    HISTORY_POINTS,
    KEPT,
    LATE_TICKS,
    LISTENERS_MAX,
    STALL_S,
    LiveCursor,
    LiveSamples,
    TooManyListenersError,
)
from tests.support.apps import create_app
from tests.support.arms import with_arm
from tests.support.keys import key_of_each_scope

from . import samples
from .harness import Harness
from .streams import Stream

PERIOD_S = samples.PERIOD_S
NO_READING = fault(FaultCode.INSTRUMENT_INVALID, "no target")


class Scene:
    """A rig with given messages, and a clock that advances by one period per tick."""

    def __init__(self, period_s: float = PERIOD_S) -> None:
        self.bus = MemoryBus()
        self.now_s = 100.0
        self.live = LiveSamples("demo", period_s, lambda: self.now_s)
        for topic in (POSITION, ESTIMATE, TELEMETRY, APPLIED):
            self.bus.subscribe(topic, self.live.take)

    def say(self, messages: Iterable[Message]) -> None:
        for message in messages:
            self.bus.publish(message)
        while self.bus.pump():
            pass

    def play(self, ticks: Iterable[samples.Tick]) -> None:
        for tick in ticks:
            self.now_s += PERIOD_S
            self.say(tick.messages())

    def idle(self, first: int, count: int, epoch: int = 7) -> None:
        """Return position and voltage only, as between two jobs."""
        applied = samples.grip(epoch)[0].applied
        for seq in range(first, first + count):
            self.now_s += PERIOD_S
            position = Position(epoch, seq, seq * PERIOD_S, (ArmPosition(0.01, valid=True),))
            self.say((position, replace(applied, seq=seq)))


@pytest.fixture
def scene() -> Scene:
    return Scene()


def zeroed_ticks(count: int) -> list[samples.Tick]:
    """Return the first ticks of a grip whose force is known."""
    ticks = list(samples.grip())
    first = next(n for n, one in enumerate(ticks) if one.estimate.arms[0].zero_age_s is not None)
    return ticks[first : first + count]


def heard(listener: LiveCursor) -> list[LiveBatch]:
    return listener.batches(1.0)


def seqs(batches: list[LiveBatch]) -> list[int]:
    return [seq for batch in batches for seq in batch.seq]


@pytest.mark.parametrize("arms", [1, 2])
def test_an_unconfirmed_voltage_is_unknown(scene: Scene, arms: int) -> None:
    """The rest of its sample is, and the sample waits for nothing else."""
    listener = scene.live.open()
    ticks = samples.grip()[:6]
    for tick in ticks:
        position, applied = tick.position, replace(tick.applied, unconfirmed=tick is ticks[3])
        if arms == 2:
            position = replace(position, arms=(*position.arms, ArmPosition(1.0, valid=True)))
            applied = replace(applied, arms=(*applied.arms, ArmApplied(2.0, 0)))
        scene.say((position, tick.estimate, tick.telemetry, applied))
    batches = heard(listener)
    found = [volts for batch in batches for volts in batch.voltage_V]
    assert found == [
        None if tick is ticks[3] else round(tick.applied.arms[0].voltage_V, 4) for tick in ticks
    ]
    assert None not in [x_um for batch in batches for x_um in batch.x_um]
    others = [volts for batch in batches if batch.second for volts in batch.second.voltage_V]
    assert others == ([] if arms == 1 else [2.0, 2.0, 2.0, None, 2.0, 2.0])


def test_samples_are_joined_by_number_and_separated_by_phase(scene: Scene) -> None:
    listener = scene.live.open()
    ticks = samples.grip()[:60]
    scene.play(ticks)
    batches = heard(listener)
    assert [batch.phase for batch in batches] == ["zero", "approach"]
    assert seqs(batches) == [tick.position.seq for tick in ticks]
    last, tick = batches[-1], ticks[-1]
    assert last.playing
    assert last.epoch == tick.position.epoch
    assert last.x_um[-1] == pytest.approx(tick.position.arms[0].x_um, abs=1e-4)
    assert last.x_r_um[-1] == pytest.approx(tick.telemetry.arms[0].x_r_um, abs=1e-4)
    assert last.force_mN[-1] == pytest.approx(tick.estimate.arms[0].force_mN, abs=1e-4)
    assert last.force_r_mN[-1] == pytest.approx(tick.telemetry.force_r_mN, abs=1e-4)
    assert last.voltage_V[-1] == pytest.approx(tick.applied.arms[0].voltage_V, abs=1e-4)
    assert last.sliding_um[-1] == pytest.approx(tick.telemetry.sliding_um, abs=1e-4)
    assert all(batch.dropped == 0 for batch in batches)


def test_a_published_sample_is_not_published_again(scene: Scene) -> None:
    listener = scene.live.open()
    ticks = samples.grip()
    scene.play(ticks[:10])
    first = seqs(heard(listener))
    scene.play(ticks[10:25])
    assert seqs(heard(listener)) == list(range(10, 25))
    assert first == list(range(10))
    assert heard(listener) == []


def test_the_order_of_messages_within_a_tick_does_not_matter(scene: Scene) -> None:
    listener = scene.live.open()
    for tick in samples.grip()[:20]:
        scene.say((tick.position, tick.applied, tick.estimate, tick.telemetry))
    batches = heard(listener)
    assert seqs(batches) == list(range(20))
    assert None not in batches[0].x_r_um


def test_live_samples_have_no_gap_if_messages_after_a_stall_arrive_grouped_by_program(
    scene: Scene,
) -> None:
    listener = scene.live.open()
    ticks = zeroed_ticks(60)
    scene.play(ticks[:10])
    stalled = ticks[10:50]
    for messages in zip(*(tick.messages() for tick in stalled), strict=True):
        scene.say(messages)
    scene.play(ticks[50:])
    batches = heard(listener)
    assert seqs(batches) == [tick.position.seq for tick in ticks]
    for batch in batches:
        assert None not in batch.force_mN
        assert None not in batch.x_r_um
        assert None not in batch.voltage_V


@pytest.mark.parametrize("ahead", [1, 3])
def test_live_samples_have_no_gap_if_other_messages_arrive_before_the_position(
    scene: Scene, ahead: int
) -> None:
    listener = scene.live.open()
    ticks = zeroed_ticks(60)
    scene.play(ticks[:10])
    late = ticks[10:]
    for group in (late[n : n + ahead] for n in range(0, len(late), ahead)):
        scene.say(one for tick in group for one in (tick.estimate, tick.telemetry, tick.applied))
        scene.say(tick.position for tick in group)
    batches = heard(listener)
    assert seqs(batches) == [tick.position.seq for tick in ticks]
    for batch in batches:
        assert None not in batch.force_mN
        assert None not in batch.x_r_um
        assert None not in batch.voltage_V


def test_messages_without_a_position_are_kept_up_to_a_limit(scene: Scene) -> None:
    ticks = zeroed_ticks(1)
    scene.play(ticks)
    listener = scene.live.open()
    heard(listener)
    first = ticks[0].position.seq + 1
    beyond = EARLY_MOST + 1
    for seq in range(first, first + beyond):
        scene.say([replace(ticks[0].estimate, seq=seq)])
    for seq in range(first, first + beyond):
        scene.now_s += STALL_S
        scene.say([replace(ticks[0].position, seq=seq)])
    found = [force_mN for batch in heard(listener) for force_mN in batch.force_mN]
    assert found[0] is None
    assert None not in found[1:]


def test_samples_are_shown_after_the_estimates_have_ended(scene: Scene) -> None:
    listener = scene.live.open()
    ticks = zeroed_ticks(100)
    scene.play(ticks[:10])
    for tick in ticks[10:]:
        scene.now_s += PERIOD_S
        scene.say(one for one in tick.messages() if not isinstance(one, Estimate))
    found = [pair for one in heard(listener) for pair in zip(one.seq, one.force_mN, strict=True)]
    late = ceil(STALL_S / PERIOD_S) + 1
    assert len(found) >= len(ticks) - late
    assert [seq for seq, _ in found] == [tick.position.seq for tick in ticks[: len(found)]]
    assert [force_mN is None for _, force_mN in found] == [n >= 10 for n in range(len(found))]


def test_a_sample_without_telemetry_is_published_late_with_the_phase(
    scene: Scene,
) -> None:
    listener = scene.live.open()
    ticks = samples.grip()[: 6 + LATE_TICKS]
    for tick in ticks:
        selected = [m for m in tick.messages() if not (isinstance(m, Telemetry) and m.seq == 3)]
        scene.say(selected)
    batches = heard(listener)
    assert seqs(batches) == sorted(seqs(batches))
    assert [batch.phase for batch in batches] == ["zero"]
    assert batches[0].x_r_um[3] is None
    assert batches[0].voltage_V[3] is not None


def test_samples_after_the_end_of_a_program_have_no_phase(scene: Scene) -> None:
    listener = scene.live.open()
    ticks = samples.grip()[:5]
    scene.play(ticks)
    after = range(5, 5 + 3 * LATE_TICKS)
    idle = replace(ticks[-1].applied, state="frozen")
    for seq in after:
        position = replace(ticks[-1].position, seq=seq)
        scene.say((position, replace(idle, seq=seq)))
    batches = heard(listener)
    assert [batch.phase for batch in batches] == ["zero", ""]
    assert [batch.playing for batch in batches] == [True, False]
    assert batches[0].seq == list(range(5))


def test_an_idle_rig_has_only_position_and_voltage(scene: Scene) -> None:
    listener = scene.live.open()
    scene.idle(0, 3 * LATE_TICKS)
    batches = heard(listener)
    assert len(seqs(batches)) >= 2 * LATE_TICKS
    assert not batches[0].playing
    assert batches[0].phase == ""
    assert batches[0].x_um[0] == 0.01
    assert batches[0].voltage_V[0] is not None
    assert set(batches[0].force_mN) == set(batches[0].x_r_um) == {None}


def test_invalid_values_are_not_shown(scene: Scene) -> None:
    listener = scene.live.open()
    tick = samples.grip()[0]
    blind = with_arm(tick.position, valid=False, x_um=0.0, fault=NO_READING)
    scene.say((blind, with_arm(tick.estimate, zero_age_s=None), tick.telemetry, tick.applied))
    (batch,) = heard(listener)
    assert batch.x_um == [None]
    assert batch.force_mN == [None]


def test_a_new_epoch_starts_a_new_batch(scene: Scene) -> None:
    listener = scene.live.open()
    scene.play(samples.grip(7)[:5])
    scene.play(samples.grip(8)[:5])
    batches = heard(listener)
    assert [batch.epoch for batch in batches] == [7, 8]
    assert [batch.seq for batch in batches] == [list(range(5)), list(range(5))]
    assert batches[1].at_s[0] > batches[0].at_s[-1]


def test_a_new_listener_receives_the_past_samples_with_reduced_density(scene: Scene) -> None:
    scene.idle(0, KEPT)
    batches = heard(scene.live.open())
    found = seqs(batches)
    assert HISTORY_POINTS / 2 < len(found) <= HISTORY_POINTS
    assert found[-1] >= KEPT - 2 * LATE_TICKS
    assert found[0] < KEPT / 100
    assert batches[0].dropped == 0


def test_a_slow_listener_gets_fewer_points_and_the_number_of_missed_ones(
    scene: Scene,
) -> None:
    listener = scene.live.open()
    scene.idle(0, 100)
    heard(listener)
    scene.idle(100, 2 * KEPT)
    batches = heard(listener)
    assert len(seqs(batches)) <= EVENT_POINTS
    assert batches[0].dropped == KEPT
    assert sum(batch.dropped for batch in batches[1:]) == 0


def test_missing_samples_are_marked_as_a_gap_and_late_ones_are_not(scene: Scene) -> None:
    listener = scene.live.open()
    ticks = samples.grip()[:60]
    scene.play(ticks[:20])
    scene.now_s += 2.0  # this process was stalled; nothing was lost
    scene.play(ticks[20:40])
    scene.play(ticks[45:60])
    batches = heard(listener)
    gaps = dict(pair for batch in batches for pair in zip(batch.seq, batch.after_gap, strict=True))
    assert [seq for seq, gap in gaps.items() if gap] == [ticks[45].position.seq]


def test_a_gap_is_kept_when_samples_are_reduced(scene: Scene) -> None:
    listener = scene.live.open()
    heard(listener)
    scene.idle(0, 200)
    scene.idle(203, 197)
    (batch,) = heard(listener)
    assert len(batch.seq) < 397
    assert sum(batch.after_gap) == 1


def test_live_samples_of_a_fast_rig_are_reduced_on_arrival() -> None:
    scene = Scene(period_s=0.001)
    listener = scene.live.open()
    scene.idle(0, 1000)
    found = seqs(heard(listener))
    steps = {after - before for before, after in pairwise(found)}
    assert steps == {17}


def test_silence_is_reported_periodically(scene: Scene) -> None:
    listener = scene.live.open()
    (sign,) = heard(listener)
    assert sign.seq == []
    scene.now_s += 0.5
    assert heard(listener) == []
    scene.now_s += 0.6
    assert [batch.seq for batch in heard(listener)] == [[]]


def test_each_client_has_a_limited_number_of_listeners(scene: Scene) -> None:
    for client in ("ann", "ben", "cell-7"):
        for _ in range(LISTENERS_MAX):
            scene.live.open(client)
        with pytest.raises(TooManyListenersError):
            scene.live.open(client)
    scene.live.open("ann", LISTENERS_MAX + 1)
    scene.live.leave("ben")
    scene.live.open("ben")


def test_columns_without_numbers_are_refused() -> None:
    with pytest.raises(ValidationError):
        LiveBatch.model_validate({"rig": "demo", "seq": ["one"]})


def test_the_stream_of_samples_ends_with_the_key_of_its_listener(harness: Harness) -> None:
    access = Access(Authenticator())
    harness.app = create_app(harness.rigs, access)
    keys = key_of_each_scope(harness.store, access.authenticator)

    async def scene() -> None:
        path = "/api/v1/rigs/demo/live"
        async with Stream(harness.app, path, **keys.headers("observe")) as stream:
            assert await stream.chunk() is not None
            await asyncio.to_thread(KeyFile(harness.store.folder).revoke, "an-observe")
            access.authenticator.refresh(harness.store)
            # One may have been made before.
            assert await stream.chunk() is None or await stream.chunk() is None

    asyncio.run(scene())


def test_the_first_listener_receives_the_samples_of_a_job_before_it(harness: Harness) -> None:
    harness.ended(harness.grip()["id"])
    batches = harness.get("/rigs/demo/samples")["batches"]
    assert {"load", "hold"} <= {batch["phase"] for batch in batches}


def test_an_unknown_rig_is_a_problem(harness: Harness) -> None:
    answer = harness.call("GET", "/api/v1/rigs/other/live")
    assert answer.status_code == 404
    assert "no rig 'other'; there are demo" in answer.json()["detail"]
