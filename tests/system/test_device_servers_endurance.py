"""50 readings a second through ser2net and socat, and over the same terminal directly, in one
run."""

import multiprocessing
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from math import inf
from pathlib import Path
from statistics import median, quantiles
from threading import Event

import pytest

from pincette.instruments import icpdas_i7024, keyence_lkg
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import serve
from tests.contract.test_late_answers import output_settings, sensor_settings
from tests.support.device_servers import ser2net, socat

pytestmark = [pytest.mark.usefixtures("stalls"), pytest.mark.real_time]

PERIOD_S = 0.02
MOST_MORE_S = 1.5e-3
"""Longest time that a device server may add to a reading, in s."""
MOST_TIMES = 2.0
"""Ratio of the 99th percentile of readings to their median."""
WAYS = ("direct", "ser2net", "socat")
BAUD = 115200
UNTIL_S = 20.0


def instruments(folder: str) -> None:
    """Serve three lasers and an output at terminals, in a separate process, until it is stopped."""
    with ExitStack() as served:
        for way in WAYS:
            served.enter_context(
                serve(f"{folder}/{way}", SimulatedKeyence(lambda: 12.34), baud=BAUD)
            )
        module = SimulatedI7024(lambda _voltage_V: None, time.monotonic)
        served.enter_context(serve(f"{folder}/output", module, baud=BAUD))
        Event().wait()


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[Path]:
    process = multiprocessing.get_context("spawn").Process(
        target=instruments, args=(str(tmp_path),), daemon=True
    )
    process.start()
    try:
        until_s = time.monotonic() + UNTIL_S
        while not (tmp_path / "output").exists():
            assert process.is_alive()
            assert time.monotonic() < until_s
            time.sleep(0.05)  # another process makes the file
        yield tmp_path
    finally:
        process.terminate()
        process.join()


@pytest.mark.parametrize("duration_s", [30.0, pytest.param(600.0, marks=pytest.mark.slow)])
def test_readings_at_50_hz_through_both_servers_are_as_fast_as_direct_ones(
    duration_s: float, terminals: Path, figures: list[str]
) -> None:
    """The long test needs a quiet machine; the short one allows for delays of direct readings."""
    took_s: dict[str, list[float]] = {way: [] for way in WAYS}
    late = 0
    with ExitStack() as running:
        for way in (*WAYS[1:], "output.socat"):
            (terminals / f"{way}.server").mkdir()
        urls = {"direct": str(terminals / "direct")}
        urls["ser2net"] = running.enter_context(
            ser2net(
                str(terminals / "ser2net"), terminals / "ser2net.server", options="chardelay: false"
            )
        ).url
        urls["socat"] = running.enter_context(
            socat(str(terminals / "socat"), terminals / "socat.server")
        ).url
        output_url = running.enter_context(
            socat(str(terminals / "output"), terminals / "output.socat.server")
        ).url
        laser = sensor_settings("keyence_lkg", 1.0)
        sensors = {
            way: running.enter_context(
                closing(keyence_lkg.open_sensor(laser.model_copy(update={"url": url})))
            )
            for way, url in urls.items()
        }
        module = output_settings("icpdas_i7024", 1.0, watchdog_s=0.0).model_copy(
            update={"url": output_url}
        )
        output = running.enter_context(closing(icpdas_i7024.open_output(module)))
        due_s = time.monotonic()
        for tick in range(round(duration_s / PERIOD_S)):
            # Readings at 50 Hz in real time are measured.
            time.sleep(max(0.0, due_s - time.monotonic()))
            for way, sensor in sensors.items():
                began_s = time.monotonic()
                sensor.read_um()
                took_s[way].append(time.monotonic() - began_s)
            output.write_V(0.001 * (tick % 2))
            due_s += PERIOD_S
            late += time.monotonic() > due_s
            due_s = max(due_s, time.monotonic() - PERIOD_S)
    medians_s = {way: median(times_s) for way, times_s in took_s.items()}
    p99_s = {way: quantiles(times_s, n=100)[-1] for way, times_s in took_s.items()}
    shown = ", ".join(f"{w} {1e3 * medians_s[w]:.2f}/{1e3 * p99_s[w]:.2f} ms" for w in WAYS)
    figures.append(f"{duration_s:g} s at 50 Hz, median/p99 of a reading: {shown}; {late} late")
    is_long = duration_s > 100.0
    for way in WAYS[1:]:
        assert medians_s[way] - medians_s["direct"] <= MOST_MORE_S
        most_s = MOST_TIMES * medians_s[way]
        allowed_s = -inf if is_long else p99_s["direct"] + MOST_MORE_S
        assert p99_s[way] <= max(most_s, allowed_s), shown
    if is_long:
        assert late == 0
