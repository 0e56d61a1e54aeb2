"""A job that trips by the age of its commands states the stalls of the machine, and suitable
settings."""

from msgspec.structs import asdict

from pincette.core.messages.requests import ExchangeTimes
from pincette.engine.measuring.kept import FILE, keep
from pincette.engine.measuring.machine import Findings
from pincette.latency.rule import Measured
from tests.support.histograms import counted

from .canned import IN_APPROACH
from .harness import Harness

HOW = "`pincette latency --seconds 5 --period-s 0.02` measures the machine"
STALLED = "command_age: no command for 51 ms, limit 50 ms"


def tripped(harness: Harness, why: str = STALLED) -> str:
    """Return the cause of a grip that tripped during its motion."""
    job = harness.playing_to(IN_APPROACH)
    harness.bus.trip(why)
    return str(harness.ended(job)["cause"])


def test_the_cause_states_the_stall_of_the_machine_and_a_remedy(real: Harness) -> None:
    cause = tripped(real)
    assert "commands came within 8 ms of their samples, p99.9 8 ms" in cause
    # 20 ms + 2 · (51 - 20) ms + 8 ms = 90 ms
    assert "[safety] command_age_periods = 4.5 (the latest wake-up was late by 31.0 ms" in cause
    assert cause.endswith(HOW)


def test_a_measured_later_wake_up_counts(real: Harness) -> None:
    late = (Measured(0.02, counted([0.06] * 1000), 0),)
    hop = counted([0.0002] * 1000)
    data = real.manager.context.records.parent
    keep(data, Findings(late, hop, "", "Linux 6", 2, 0.0, False), "2026-03-01")
    assert (data / FILE).is_file()
    assert "command_age_periods = 7.5 (the latest wake-up was late by 60.0 ms" in tripped(real)


def test_another_trip_does_not_mention_the_machine(real: Harness) -> None:
    assert HOW not in tripped(real, "device: no answer")


def test_in_lockstep_no_machine_is_too_slow(harness: Harness) -> None:
    assert tripped(harness) == f"actuator tripped: {STALLED}"


def test_a_trip_by_age_names_the_measured_exchanges_with_the_instruments(real: Harness) -> None:
    real.bus.exchanges["sensor"] = (ExchangeTimes(40, 0.002, 0.0021, 0.093),)
    real.bus.exchanges["actuator"] = (ExchangeTimes(5, 0.001, 0.0012, 0.0015),)
    job = real.playing_to(IN_APPROACH)
    real.bus.trip(STALLED)
    ended = real.ended(job)
    assert "sensor worst 93.0 ms" in ended["cause"]
    (found,) = [one for one in ended["ending"]["faults"] if one["code"] == "exchange_times"]
    assert found["values"]["sensor_median_s"] == 0.0021
    assert found["values"]["output_worst_s"] == 0.0015


def test_instruments_measured_too_slow_prevent_jobs(real: Harness) -> None:
    took = ExchangeTimes(40, 0.026, 0.027, 0.03)
    real.bus.exchanges["sensor"] = (took,)
    rig = real.get("/rigs/demo")
    assert not rig["can_start"]
    assert "sensor exchange 27.0 (measured, stated 1.8)" in "".join(rig["reasons"])
    (sensor,) = (one for one in rig["programs"] if one["name"] == "sensor")
    assert sensor["exchanges"] == [asdict(took)]
    labels = 'arm="1",rig="demo",service="sensor",statistic="median"'
    metrics = real.call("GET", "/metrics").text
    assert f"pincette_instrument_exchange_seconds{{{labels}}} 0.027" in metrics
    real.bus.exchanges["sensor"] = (ExchangeTimes(40, 0.002, 0.002, 0.03),)
    real.manager.context.health.refresh(force=True)
    assert real.get("/rigs/demo")["can_start"]
