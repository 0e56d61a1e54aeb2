"""The content of a scrape, by Prometheus' own parsers; access to it; and the number of series."""

from collections.abc import Callable
from typing import cast

import pytest
from msgspec.structs import replace
from prometheus_client import Metric
from prometheus_client.openmetrics import parser as openmetrics
from prometheus_client.parser import text_string_to_metric_families

from pincette.config import RigFile
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.metrics import FAMILIES, MOST_RIGS
from tests.support.histograms import counted
from tests.support.keys import ScopeKeys

from . import samples
from .harness import Harness
from .rigs_harness import RigsHarness, joined

Series = dict[tuple[str, frozenset[tuple[str, str]]], float]
OPEN = "application/openmetrics-text; version=1.0.0"


def scraped(harness: Harness) -> list[Metric]:
    response = harness.call("GET", "/metrics")
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    return list(text_string_to_metric_families(response.text))


def series(harness: Harness) -> Series:
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in scraped(harness)
        for sample in family.samples
    }


def value(harness: Harness, name: str, **labels: str) -> float:
    return series(harness)[name, frozenset(({"rig": "demo"} | labels).items())]


def test_every_metric_of_the_table_is_served_in_both_formats_and_no_other(harness: Harness) -> None:
    harness.ended(harness.grip()["id"])
    found = {family.name: family for family in scraped(harness)}
    for family in FAMILIES:
        served = found.pop(family.name.removesuffix("_total"))
        assert served.type == family.kind
        assert served.documentation == family.meaning
        for sample in served.samples:
            assert set(sample.labels) - {"le"} == set(family.labels), sample
    assert not found
    response = harness.call("GET", "/metrics", headers={"Accept": OPEN})
    assert response.headers["content-type"].startswith("application/openmetrics-text")
    name = "text_string_to_metric_families"  # which has no types
    parse = cast("Callable[[str], list[Metric]]", vars(openmetrics)[name])
    assert len(list(parse(response.text))) == len(FAMILIES)


def test_a_grip_is_counted(harness: Harness) -> None:
    states = {"rig": "demo", "kind": "grip", "state": "succeeded"}
    assert value(harness, "pincette_jobs", **states) == 0.0
    assert harness.ended(harness.grip()["id"])["state"] == "succeeded"
    assert value(harness, "pincette_jobs", **states) == 1.0
    assert value(harness, "pincette_command_age_seconds_count") > 200
    force_N = 1e-3 * max(
        tick.estimate.arms[0].force_mN for tick in samples.grip() if tick.estimate.valid
    )
    assert value(harness, "pincette_force_peak_newtons") == pytest.approx(force_N)
    assert value(harness, "pincette_arming_force_peak_newtons_bucket", le="0.01") == 0.0
    assert value(harness, "pincette_arming_force_peak_newtons_bucket", le="0.05") == 1.0
    assert value(harness, "pincette_dropped_total", service="sensor", kind="gap") == 0.0


def test_a_trip_is_counted_by_its_cause_and_latches(harness: Harness) -> None:
    assert value(harness, "pincette_latched") == 0.0
    assert value(harness, "pincette_trips_total", cause="estop") == 0.0
    assert harness.post("/rigs/demo/estop").status_code == 200
    assert value(harness, "pincette_trips_total", cause="estop") == 1.0
    assert value(harness, "pincette_trips_total", cause="command_age") == 0.0
    assert value(harness, "pincette_latched") == 1.0


def test_a_missing_or_hanging_program_is_not_up(harness: Harness) -> None:
    harness.health.refresh(force=True)
    assert value(harness, "pincette_service_up", service="estimator") == 1.0
    harness.bus.kill("estimator")
    assert value(harness, "pincette_service_up", service="estimator") == 0.0
    harness.bus.silent.add("controller")  # its token stays
    harness.health.refresh(force=True)
    assert value(harness, "pincette_service_up", service="controller") == 0.0
    assert value(harness, "pincette_service_up", service="recorder") == 1.0


def test_timing_is_reported_in_real_time_only(harness: Harness) -> None:
    names = {name for name, _ in series(harness)}
    assert "pincette_lateness_seconds_bucket" not in names
    assert "pincette_command_age_seconds_bucket" in names


def test_published_timing_is_exported(
    real_time: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness = open_harness(real_time)
    timing = replace(samples.timing("sensor", 4), lateness=counted([0.001, 0.03]), missed=3)
    harness.bus.publish(timing)
    assert value(harness, "pincette_lateness_seconds_bucket", service="sensor", le="0.02") == 1.0
    assert value(harness, "pincette_lateness_seconds_bucket", service="sensor", le="+Inf") == 2.0
    assert value(harness, "pincette_lateness_seconds_count", service="sensor") == 2.0
    assert value(harness, "pincette_missed_ticks_total", service="sensor") == 3.0
    again = replace(timing, epoch=timing.epoch + 1, lateness=counted([0.002]), missed=0)
    harness.bus.publish(again)
    assert value(harness, "pincette_lateness_seconds_count", service="sensor") == 3.0
    assert value(harness, "pincette_missed_ticks_total", service="sensor") == 3.0


@pytest.mark.parametrize("accept", ["", "*/*", "text/plain; version=none", f"{OPEN[:-5]}x"])
def test_an_unknown_format_returns_plain_text(harness: Harness, accept: str) -> None:
    response = harness.call("GET", "/metrics", headers={"Accept": accept})
    assert response.status_code == 200
    assert list(text_string_to_metric_families(response.text))


def test_observers_may_scrape(harness: Harness, ring: ScopeKeys) -> None:
    assert harness.call("GET", "/metrics").status_code == 401
    for scope in ("observe", "operate", "admin"):
        assert harness.call("GET", "/metrics", headers=ring.headers(scope)).status_code == 200


def test_without_a_journal_the_other_metrics_are_reported(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unread() -> dict[tuple[str, str, str], int]:
        raise StoreError("unreadable")

    monkeypatch.setattr(harness.store, "counted", unread)
    names = {name for name, _ in series(harness)}
    assert "pincette_jobs" not in names
    assert "pincette_trips_total" in names


def test_the_number_of_time_series_is_bounded(harness: Harness) -> None:
    harness.ended(harness.grip()["id"])
    before = series(harness).keys()
    for number in range(30):
        harness.bus.publish(samples.timing(f"invented-{number}", number))
        harness.bus.trip(f"invented cause {number}")
    assert series(harness).keys() == before
    assert len(before) < 300


def test_each_rig_has_its_own_metrics_and_rigs_beyond_the_limit_are_counted(
    rig_file: RigFile, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    rigs_harness = RigsHarness(rig_file, tmp_path_factory.mktemp("rigs"))
    try:
        rigs_harness.come(joined(rig_file, "right"))
        rigs_harness.served("right")
        rigs = {dict(labels).get("rig") for _, labels in series(rigs_harness)}
        assert rigs == {None, "demo", "right"}
        monkeypatch.setattr("pincette_supervisor.metrics.MOST_RIGS", 1)
        assert MOST_RIGS >= 2
        found = series(rigs_harness)
        assert found["pincette_rigs_left_out", frozenset()] == 1.0
        assert {dict(labels).get("rig") for _, labels in found} == {None, "demo"}
    finally:
        rigs_harness.close()
