"""The metrics of a rig in real time during a grip, while a program is dead, and after its
restart."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

from time import monotonic, sleep

import pytest
from prometheus_client.parser import text_string_to_metric_families

from pincette.core.topics import LOOP
from tests.support.grips import kill, restart
from tests.support.running import RunningRig

pytestmark = pytest.mark.usefixtures("stalls")

TOLD_S = 8.0
"""Time within which a value that is published about once a second must appear, in s."""
Scrape = dict[tuple[str, frozenset[tuple[str, str]]], float]


def scrape(rig: RunningRig) -> Scrape:
    response = rig.client.get(str(rig.client.base_url.join("/metrics"))).raise_for_status()
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(response.text)
        for sample in family.samples
    }


def value(found: Scrape, name: str, **labels: str) -> float:
    return found[name, frozenset(({"rig": "demo"} | labels).items())]


def until(rig: RunningRig, name: str, wanted: float, **labels: str) -> Scrape:
    """Scrape until a value satisfies a condition."""
    deadline = monotonic() + TOLD_S
    while True:
        found = scrape(rig)
        if value(found, name, **labels) == wanted:
            return found
        assert monotonic() < deadline, (name, labels, value(found, name, **labels))
        sleep(0.1)


def counters(found: Scrape) -> Scrape:
    return {
        place: number
        for place, number in found.items()
        if place[0].endswith(("_total", "_bucket", "_count"))
    }


def test_metrics_show_the_rig_and_no_counter_decreases(rig: RunningRig) -> None:
    idle = scrape(rig)
    assert [value(idle, "pincette_service_up", service=name) for name in LOOP] == [1.0] * 4
    job = rig.start_grip()
    rig.until_phase(job, "hold")
    gripping = scrape(rig)
    assert value(gripping, "pincette_jobs", kind="grip", state="running") == 1.0
    assert value(gripping, "pincette_command_age_seconds_count") > 20
    assert rig.ended(job)["state"] == "succeeded"
    done = until(rig, "pincette_jobs", 1.0, kind="grip", state="succeeded")
    peak_N = value(done, "pincette_force_peak_newtons")
    assert 0.006 < peak_N < 0.02
    assert value(done, "pincette_arming_force_peak_newtons_count") == 1.0
    for name in LOOP:
        assert value(done, "pincette_lateness_seconds_count", service=name) > 50
        assert value(done, "pincette_execution_seconds_sum", service=name) > 0.0
    fallen = {place for place, number in counters(idle).items() if done[place] < number}
    assert not fallen

    ages = value(done, "pincette_lateness_seconds_count", service="estimator")
    kill(rig, "estimator")
    dead = until(rig, "pincette_service_up", 0.0, service="estimator")
    assert value(dead, "pincette_service_up", service="sensor") == 1.0
    restart(rig, "estimator")
    until(rig, "pincette_service_up", 1.0, service="estimator")
    assert rig.ended(rig.start_grip())["state"] == "succeeded"
    back = until(rig, "pincette_arming_force_peak_newtons_count", 2.0)
    assert value(back, "pincette_lateness_seconds_count", service="estimator") > ages
    assert not {place for place, number in counters(done).items() if back[place] < number}
    estop = value(back, "pincette_trips_total", cause="estop")
    assert rig.post("/rigs/demo/estop").status_code == 200
    until(rig, "pincette_trips_total", estop + 1.0, cause="estop")
