"""Holds without an end: progress continues, memory does not grow, and the job ends properly."""

from time import monotonic, sleep

import pytest
from msgspec.structs import replace

from pincette.core.faults import Outcome
from pincette.core.messages import Message, Sample
from pincette.core.topics import TOPIC_OF
from pincette.records.row_blocks import RowBlocks
from pincette_supervisor.results import run_samples
from pincette_supervisor.results.run_samples import RunSamples
from pincette_supervisor.rigs.observer import MessageBuffer
from tests.support.memory import resident_MB

from . import samples
from .canned import IN_HOLD
from .harness import Harness
from .samples import PERIOD_S

PER_TICK = 6
"""Messages of each tick: those of five topics, and the truth of the simulation."""
BEHIND = 5000
"""Ticks that the feed may be ahead of the run that follows it."""


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small buffer, and blocks of few rows of which few are kept: bounds are reached soon."""
    monkeypatch.setattr(RowBlocks.__init__, "__kwdefaults__", {"every_tick": True, "rows": 512})
    monkeypatch.setattr(MessageBuffer.__init__, "__defaults__", (60_000,))
    monkeypatch.setattr(run_samples, "HELD_ROWS", 1024)
    monkeypatch.setattr(run_samples, "EXTREME_ROWS", 64)


class LongHold:
    """A canned grip that stays in its hold while ticks are fed."""

    def __init__(self, harness: Harness) -> None:
        self.harness, self.bus = harness, harness.bus
        self.job = harness.playing_to(IN_HOLD, until_released=True)
        self._tick = self.bus.ticks[IN_HOLD - 1]
        self._begin = len(self.bus.ticks)
        self.seq = IN_HOLD - 1
        self.live = harness.live

    def feed(self, ticks: int, **view: object) -> None:
        """Publish so many ticks of the hold, as fast as the run follows them."""
        telemetry = replace(self._tick.telemetry, **view)
        made = replace_tick(self._tick, telemetry)
        for number in range(ticks):
            self.seq += 1
            for message in made:
                numbered = replace(message, seq=self.seq)
                for sink in self.bus.sinks(TOPIC_OF[type(message)]):
                    sink(TOPIC_OF[type(message)], numbered)
            if number % 1000 == 0:
                self.catch_up(BEHIND)

    def catch_up(self, behind: int = 0) -> None:
        """Wait until the progress of the job is that of the newest ticks."""
        until_s = monotonic() + 300.0
        while (now := self.live.status.progress) is None or now.seq < self.seq - behind:
            assert monotonic() < until_s, now
            sleep(0.001)

    def release(self) -> None:
        """Release the part: the rest of the canned grip is played from here."""
        place = self.bus.place
        rest = self.bus.ticks[place:]
        self.bus.ticks[place:] = [
            samples.numbered(tick, self.seq + 1 + number) for number, tick in enumerate(rest)
        ]
        self.bus.pause_at = None
        self.harness.acted(self.job, "release")


def replace_tick(tick: samples.Tick, telemetry: Sample) -> list[Message]:
    """Return the messages of a tick with another view of the controller."""
    return [telemetry if type(one) is type(telemetry) else one for one in tick.messages()]


def check(harness: Harness, warm_up: int, ticks: int, growth_MB: float) -> None:
    hold = LongHold(harness)
    hold.feed(warm_up)
    hold.catch_up()
    begin_MB = resident_MB()
    hold.feed(ticks)
    hold.catch_up()
    grown_MB = resident_MB() - begin_MB
    print(f"{ticks * PER_TICK} messages: {grown_MB:+.1f} MB")
    assert hold.live.status.state == "running"
    assert hold.live.status.progress is not None
    assert hold.live.status.progress.phase == "hold"
    hold.release()
    ended = harness.freed(hold.job)
    assert ended["state"] == "succeeded", ended["cause"]
    assert ended["result"]["samples"] == hold.seq + 1 + len(samples.grip()) - IN_HOLD
    assert ended["result"]["missed_ticks"] == 0
    assert grown_MB < growth_MB


@pytest.mark.usefixtures("small")
def test_a_long_hold_ends_after_its_release_with_bounded_memory(harness: Harness) -> None:
    check(harness, 6000, 15_000, 8.0)


@pytest.mark.slow
def test_a_hold_of_20_million_messages_needs_bounded_memory(harness: Harness) -> None:
    check(harness, 100_000, 20_000_000 // PER_TICK, 20.0)


@pytest.mark.usefixtures("small")
def test_a_part_held_after_a_stop_is_stored_in_evenly_spaced_rows() -> None:
    kept = RunSamples(PERIOD_S)
    tick = samples.grip()[IN_HOLD]
    telemetry = replace(tick.telemetry, outcome=Outcome.STOPPED)
    for seq in range(10_000):
        for message in replace_tick(tick, telemetry):
            kept.add(replace(message, seq=seq))
    assert len(kept.tables().extreme["seq"]) < 5000


@pytest.mark.usefixtures("small")
def test_the_wait_for_a_person_is_stored_in_evenly_spaced_rows() -> None:
    kept = RunSamples(PERIOD_S, thinned=frozenset({"hang 1", "hang 2"}))
    tick = samples.grip()[IN_HOLD]
    seq = 0
    for phase, ticks in (("hang 1", 8000), ("measure 1", 2000), ("hang 2", 3)):
        telemetry = replace(tick.telemetry, phase=phase)
        for _ in range(ticks):
            for message in replace_tick(tick, telemetry):
                kept.add(replace(message, seq=seq))
            seq += 1
    phases = kept.tables().extreme["phase"]
    assert phases.count("hang 1") < 3000
    assert phases.count("measure 1") == 2000
    assert phases.count("hang 2") >= 1
