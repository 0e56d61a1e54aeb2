"""Checks of a rig's instruments when they are opened, and of the direction in which the arm
moves.
"""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass
from itertools import pairwise
from math import fsum, inf, sqrt
from pathlib import Path
from typing import cast

from pincette.config import ConfigError, RigFile, Sensor
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.plugins import PluginError
from pincette.core.service import AnyService, member_services
from pincette.diagnostics import Finding, noted
from pincette.diagnostics.hops import hop_findings, not_asked_for
from pincette.engine.exchange_times import in_words, times_of
from pincette.engine.instrument import longest_reading_s, open_for_measurement, reading_timeout_s
from pincette.engine.process import loop_services
from pincette.engine.timing_budget import budget, shared_timeout_s
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.protocols import (
    InstrumentError,
    PositionSensor,
    VoltageOutput,
    WatchedOutput,
)

READINGS = 40
COARSEST_UM, FINEST_UM = 0.05, 0.001
"""Limits of plausible steps of a reading, in µm: 0.1 µm hides 25 nm, and 1e-5 means a display in
mm."""
LATENCY_MS = 1
THIN_SHARE = 0.5
"""Fraction of a timeout above which the duration of the slowest reading leaves too small a
margin.
"""
MOVE_V, MOVE_STEPS, STEP_S = 0.2, 20, 0.05
LEAST_SHARE, MOST_SHARE = 0.3, 3.0
"""Smallest and largest ratio of measured to modelled motion for which the motion counts as that of
the arm."""
OLD_SHARE = 0.5
"""The first reading after a motion counts as outdated if it shows less than this fraction of the
motion."""
LASER_ANSWERS = re.compile(r"b['\"]ER,[$#~]")
"""Reply that reveals a laser at the output's address: a Keyence controller repeats an unknown
request.
"""
USB_SERIAL = Path("/sys/bus/usb-serial/devices")
INSTRUMENTS_HELP = (
    "instruments: simulated, started with the rig; with real ones, doctor checks whether "
    "the ports open, the latency of their adapters, 40 readings with their time, step, "
    "noise and range, the output voltage, and with --move the direction of the motion"
)


def instruments(rig: RigFile) -> Iterator[Finding]:
    """Open all instruments one after another, and check their replies; moves nothing.

    The last finding compares the control period with the measured durations.
    """
    limits = Limits.of(rig)
    sensors, outputs = list[ExchangeTimes](), list[ExchangeTimes]()
    for arm in rig.arms:
        yield from _of_arm(arm, limits, sensors, outputs)
    if len(sensors) == len(outputs) == len(rig.arms):
        yield timing(rig, sensors, outputs)


def _of_arm(
    rig: RigFile, limits: "Limits", sensors: list[ExchangeTimes], outputs: list[ExchangeTimes]
) -> Iterator[Finding]:
    """Check the instruments of one arm, and add the durations of their exchanges."""
    for service in loop_services().values():
        if service.instrument is None:
            continue
        url = _url_of(service, rig)
        counts = LineCounts()
        with counting(counts):
            device = opened_device(service, rig)
        if isinstance(device, Finding):
            yield device
            continue
        with closing(device):
            yield Finding(True, f"{service.instrument.replace('_', ' ')} at {url}")
            yield from latency(url)
            try:
                if service.instrument == "position_sensor":
                    yield from readings(
                        rig.sensor, cast(PositionSensor, device), limits.reading_s, sensors
                    )
                else:
                    output = cast(VoltageOutput, device)
                    yield from standing(rig, output)
                    yield questions(url, output, limits.output_s, outputs)
                if url in counts.arrivals:
                    hop = counts.arrivals[url].hop()
                    yield from hop_findings(f"{_called(service)} at {url}", *astuple(hop))
            except InstrumentError as error:
                what = f"{_called(service)}: {error}"
                yield Finding(False, what, remedy_of(error, _called(service), url))
            yield from not_asked_for(f"{_called(service)} at {url}", counts.unexpected)


def opened_device(service: AnyService, rig: RigFile) -> PositionSensor | VoltageOutput | Finding:
    """Open the instrument of a service, or report what prevents it."""
    try:
        device = open_for_measurement(service, rig)
    except PluginError as error:
        return Finding(False, f"{_called(service)}: {error}", "install the driver, or name another")
    except ConfigError as error:
        return Finding(False, f"{_called(service)}: {error}", "correct the options in the rig file")
    except InstrumentError as error:
        remedy = remedy_of(error, _called(service), _url_of(service, rig))
        return Finding(False, f"{_called(service)}: {error}", remedy)
    return cast("PositionSensor | VoltageOutput", device)


def remedy_of(error: InstrumentError, table: str, url: str) -> str:
    """Return the remedy for an instrument that fails; it is named by its table of the rig file.

    An error of a port states its cause and remedy. Cable and power are suspected only if no valid
    answer came and nothing else is known.
    """
    if error.code in ("cannot_open", "hung_up", "misused"):
        return f"do what the error states; `url` in [{table}] of the rig file is the port"
    if error.code not in ("silent", "late", "garbled"):
        return "look at the display of the instrument"
    if LASER_ANSWERS.search(str(error)):
        return (
            f"a Keyence laser answers at `url` in [{table}] of the rig file: are the addresses of "
            "sensor and output exchanged?"
        )
    remedy = f"check cable, power, address, baud rate, and `url` in [{table}] of the rig file"
    if url.startswith("socket://"):
        remedy += (
            "; a device server must run, have the instrument's baud rate and format, and offer a "
            "port of raw TCP, without TLS or telnet"
        )
    return remedy


def _url_of(service: AnyService, rig: RigFile) -> str:
    """Return the url of a service's instrument."""
    return rig.sensor.url if service.instrument == "position_sensor" else rig.output.url


def _called(service: AnyService) -> str:
    """Return the table of the rig file that describes the instrument of a service."""
    return "sensor" if service.instrument == "position_sensor" else "output"


def latency(url: str, devices: Path = USB_SERIAL) -> Iterator[Finding]:
    """Return how long a USB adapter buffers bytes; the port must be open."""
    timer = devices / Path(url).resolve().name / "latency_timer"
    if not url.startswith("/") or not timer.is_file():
        return
    held_ms = int(timer.read_text(encoding="ascii"))
    yield Finding(
        held_ms <= LATENCY_MS,
        f"adapter {url}: holds bytes back for {held_ms} ms, limit {LATENCY_MS} ms",
        f"echo {LATENCY_MS} | sudo tee {timer}",
    )


@dataclass(frozen=True, slots=True)
class Limits:
    """Durations after which an answer is late, in s."""

    reading_s: float
    """Limit of a reading of one arm, in s; both arms of a rig are read within one period."""
    output_s: float
    """Limit of an exchange with the output of one arm, in s."""

    @classmethod
    def of(cls, rig: RigFile) -> "Limits":
        """Return the limits of a rig."""
        name = rig.program_of("sensor")
        services = loop_services()
        try:
            shared_s = shared_timeout_s(rig, [services[one] for one in member_services(name)])
        except ConfigError:
            shared_s = inf  # a finding about the rig file states it
        arms, tick_s = len(rig.arms), longest_reading_s(rig.rig.period_s)
        reading_s = min(reading_timeout_s(rig, shared_s), tick_s / arms)
        return cls(reading_s, min(rig.output.timeout_s, rig.rig.period_s / arms))


def margin(what: str, took: ExchangeTimes, limit_s: float) -> Finding:
    """Compare durations of exchanges with the time after which they are late."""
    text = f"{what} took {in_words(took)}; later than {1e3 * limit_s:.1f} ms is late"
    remedy = (
        "a late answer is dropped, and three in a row trip: raise the baud rate, set the "
        "server's or adapter's delay to 0, or take a longer [rig] period_s"
    )
    if took.median_s > limit_s:
        return Finding(False, text, remedy)
    if took.worst_s > THIN_SHARE * limit_s:
        return noted(f"{text}: the margin is small", remedy)
    return Finding(True, text)


def timing(
    rig: RigFile, sensors: Sequence[ExchangeTimes], outputs: Sequence[ExchangeTimes]
) -> Finding:
    """Compare the control period with the larger of the stated and the measured durations."""
    needed = budget(rig).measured(sensors, outputs)
    urls = {arm.sensor.url for arm in rig.arms} | {arm.output.url for arm in rig.arms}
    return Finding(
        needed.fits,
        f"timing, measured: {needed.words()}",
        f"find what delays {' and '.join(sorted(urls))}: baud rate, the server's or adapter's "
        "delay; or take a longer [rig] period_s",
    )


def questions(
    url: str, output: VoltageOutput, limit_s: float, measured: list[ExchangeTimes]
) -> Finding:
    """Read the voltage of an output repeatedly, which moves nothing, and compare the duration with
    its limit.
    """
    took_s: list[float] = []
    for _ in range(READINGS):
        began_s = time.monotonic()
        output.read_V()
        took_s.append(time.monotonic() - began_s)
    took = times_of(took_s)
    assert took is not None
    measured.append(took)
    return margin(f"output at {url}: exchanges", took, limit_s)


def readings(
    settings: Sensor,
    sensor: PositionSensor,
    limit_s: float,
    measured: list[ExchangeTimes],
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Finding]:
    """Check that readings are fast, in range, in the right unit, and as noisy as stated."""
    times_s, x_um = [clock()], list[float]()
    for _ in range(READINGS):
        x_um.append(sensor.read_um())
        times_s.append(clock())
    took = times_of([after - before for before, after in pairwise(times_s)])
    assert took is not None
    measured.append(took)
    yield margin(f"sensor at {settings.url}: readings", took, limit_s)
    low_um, high_um = min(x_um), max(x_um)
    yield Finding(
        settings.minimum_um <= low_um and high_um <= settings.maximum_um,
        f"sensor: {READINGS} readings from {low_um:.3f} to {high_um:.3f} µm, range "
        f"{settings.minimum_um:g}..{settings.maximum_um:g} µm",
        "bring the target into the head's range, or correct [sensor] minimum_um and maximum_um",
    )
    steps_um = [b - a for a, b in zip(sorted(x_um), sorted(x_um)[1:], strict=False) if b - a > 1e-9]
    if not steps_um:
        yield noted(
            f"sensor: {READINGS} equal readings: its step cannot be determined",
            "check that it measures, and that its display resolution is 0.01 µm or 0.00001 mm",
        )
        return
    step_um = min(steps_um)
    yield Finding(
        FINEST_UM <= step_um <= COARSEST_UM,
        f"sensor: readings differ by {step_um:.2g} µm at least, limits {FINEST_UM:g} and "
        f"{COARSEST_UM:g} µm",
        "set the display to 0.01 µm or 0.00001 mm, and options.unit to what it shows",
    )
    mean_um = fsum(x_um) / READINGS
    noise_um = sqrt(fsum((x - mean_um) ** 2 for x in x_um) / (READINGS - 1))
    yield Finding(
        noise_um <= 3.0 * max(settings.noise_um, step_um),
        f"sensor: noise {noise_um:.3f} µm r.m.s., the rig file has {settings.noise_um:g} µm",
        "find what vibrates the arm; then `pincette job calibrate noise`",
    )


def standing(rig: RigFile, output: VoltageOutput) -> Iterator[Finding]:
    """Report the present voltage of the output."""
    found_V = output.read_V()
    yield Finding(
        rig.limits.voltage_min_V <= found_V <= rig.limits.voltage_max_V,
        f"output: stands at {found_V:+.3f} V, limits {rig.limits.voltage_min_V:g} and "
        f"{rig.limits.voltage_max_V:g} V",
        "bring it within the limits by hand, slowly",
    )


def direction(
    rig: RigFile,
    sensor: PositionSensor,
    output: VoltageOutput,
    sleep: Callable[[float], None] = time.sleep,
) -> Finding:
    """Raise the voltage slowly by ``MOVE_V``, check the direction of the arm, and always return."""
    begin_V = output.read_V()
    if begin_V + MOVE_V > rig.limits.voltage_max_V:
        what = f"direction: {begin_V:+.3f} V leave no room for {MOVE_V:+g} V below the limit"
        return Finding(False, what, f"bring the output to {rig.safety.safe_V:g} V first")
    reached = 0
    try:
        before_um = _mean(_readings_um(sensor, output))
        for step in range(1, MOVE_STEPS + 1):
            output.write_V(begin_V + MOVE_V * step / MOVE_STEPS)
            reached = step
            sleep(STEP_S)
        first_um, *others_um = _readings_um(sensor, output)
        moved_um = _mean(others_um) - before_um
    finally:
        for step in range(reached - 1, -1, -1):
            output.write_V(begin_V + MOVE_V * step / MOVE_STEPS)
            sleep(STEP_S)
    wanted_um = rig.sensor.direction * rig.model.piezo_um_per_V * MOVE_V
    share = moved_um / wanted_um
    if share > LEAST_SHARE and (first_um - before_um) / moved_um < OLD_SHARE:
        return Finding(
            False,
            f"direction: the first reading after the move is {first_um:.2f} µm, unchanged, "
            f"and the others are {_mean(others_um):.2f} µm: each reading is one exchange late",
            (
                "check whether a proxy or an adapter stores answers; use one that forwards "
                "bytes at once"
            ),
        )
    well = LEAST_SHARE <= share <= MOST_SHARE
    turned = f"write direction = {-rig.sensor.direction} into [sensor], or swap the signs"
    still = "check that the amplifier is on, and that the laser hits the arm's tip"
    return Finding(
        well,
        f"direction: {MOVE_V:+g} V moved the reading by {moved_um:+.2f} µm, "
        f"the rig file says about {wanted_um:+.2f} µm",
        turned if share < -LEAST_SHARE else still,
    )


def _readings_um(sensor: PositionSensor, output: VoltageOutput) -> list[float]:
    """Return several readings in µm. On a slow line this takes longer than the watchdog time of an
    output.
    """
    x_um: list[float] = []
    for _ in range(READINGS):
        if isinstance(output, WatchedOutput):
            output.keep_alive()
        x_um.append(sensor.read_um())
    return x_um


def _mean(values: list[float]) -> float:
    return fsum(values) / len(values)
