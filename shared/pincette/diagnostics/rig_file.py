"""Checks of a rig file: drivers, timing, watchdog, limits, model; nothing is opened."""

import sys
from collections.abc import Iterable, Iterator
from math import pi, sqrt
from typing import cast

from pincette.config import ConfigError, Output, RigFile, Sensor, Table, derived
from pincette.config.calibration import CALIBRATED
from pincette.core import plugins
from pincette.core.service import member_services
from pincette.diagnostics import Finding, noted
from pincette.engine.process import loop_services
from pincette.engine.timing_budget import budget, shared_timeout_s, stated_output
from pincette.instruments.options import read_options

# The two constants are also stated in pincette.control, whose import of numpy would double the
# start-up time of `pincette doctor`.
COVERAGE = 2.0
"""Coverage factor: number of standard uncertainties in the expanded uncertainty U."""
RC_S = 0.0033
"""Time constant of the recommended RC before the amplifier, in s."""
RING_NOTED = 0.02
"""Fraction of a path's range above which the uncertainty from ringing is reported."""


def rig_findings(rig: RigFile) -> Iterator[Finding]:
    """Check drivers, timing, watchdog, limits and model, for each arm."""
    drivers = tuple(
        dict.fromkeys(
            named
            for arm in rig.arms
            for named in (
                (plugins.POSITION_SENSORS, arm.sensor.driver),
                (plugins.VOLTAGE_OUTPUTS, arm.output.driver),
            )
        )
    )
    for group, name in drivers:
        yield driver(group, name)
    try:
        if rig.simulation is None:
            yield from untested_drivers(drivers)
        yield timing(rig)
        yield from ring(rig)
        for arm in rig.arms:
            yield watchdog(arm)
    except plugins.PluginError as error:
        yield Finding(False, str(error), "install the driver, or name another in the rig file")
    except ConfigError as error:
        yield Finding(False, f"options: {error}", "correct the options in the rig file")
    yield from composed(rig)
    for arm in rig.arms:
        yield from limits(arm)
        yield model(arm)


def driver(group: str, name: str) -> Finding:
    """Check whether a driver is installed."""
    there = plugins.names(group)
    remedy = f"install it, or name another in the rig file; installed are {', '.join(there)}"
    return Finding(name in there, f"driver {name}", remedy)


def untested_drivers(drivers: Iterable[tuple[str, str]]) -> Iterator[Finding]:
    """Report drivers that were never tested with their instrument."""
    for group, name in drivers:
        if _module(group, name).get("MET") is False:
            yield noted(
                f"driver {name} has not been tested with its instrument",
                "watch its first steps; `record` in the rig file records every exchange",
            )


def timing(rig: RigFile) -> Finding:
    """Check whether a tick fits into the control period, by the sum of all durations."""
    needed = budget(rig)
    notes = dict.fromkeys(one.note for one in (*needed.sensors, *needed.outputs) if one.note)
    words = "; ".join([f"timing, as the drivers state it: {needed.words()}", *notes])
    return Finding(
        needed.fits,
        words,
        "raise baud at the instrument and in options.baud (115200), or period_s in the rig file",
    )


def ring(rig: RigFile) -> Iterator[Finding]:
    """Check whether the voltage steps excite the mode, and report what prevents it.

    The path of ``[track]`` is checked if it is a sinusoid: its steps are the largest where it is
    fastest.
    """
    buffered = budget(rig).outputs[0].buffered_hz is not None
    if rig.output.shaping and not buffered:
        yield Finding(
            False,
            f"shaping: {rig.output.driver} does not time the parts of a step itself",
            f"omit [output] shaping, and fit an RC of {1000.0 * RC_S:.1f} ms before the amplifier",
        )
        return
    output = stated_output(rig)
    shares = derived.ring_shares(rig, output)
    period_s, track = rig.rig.period_s, rig.track
    if shares.pressed == 0.0 or track.shape != "sinusoid":
        return
    compliance = rig.model.compliance_um_per_mN
    stroke_um = track.force_pp_mN * (compliance + 1.0 / rig.part.stiffness_mN_per_um)
    step_um = stroke_um * pi * track.frequency_hz * period_s
    ring_mN = COVERAGE * shares.pressed * step_um / sqrt(1.0 - shares.kept**2) / compliance
    share = ring_mN / track.force_pp_mN
    words = (
        f"ring: the steps of a path of {track.force_pp_mN:g} mN peak to peak at "
        f"{track.frequency_hz:g} Hz make the force uncertain by {ring_mN:.2f} mN "
        f"({100.0 * share:.1f} %)"
    )
    if rig.model.output_delay_s is None and share > RING_NOTED:
        yield noted(
            f"{words}, which U does not count: the rig file has no model.output_delay_s",
            f"write output_delay_s = {output.delay_s:.4g} and output_lag_s = {output.lag_s:.4g} "
            "into [model]: what the drivers state, or what was measured",
        )
    if share <= RING_NOTED:
        yield Finding(True, words)
        return
    remedy = (
        "set shaping = true in [output]"
        if buffered and rig.second is None
        else f"fit an RC of {1e3 * RC_S:.1f} ms before the amplifier, and write output_lag_s = "
        f"{RC_S:g} into [model]"
    )
    known = rig.model.output_delay_s is not None
    lag_s = rig.model.output_lag_s if known else output.lag_s
    calm = rig.output.shaping or lag_s >= RC_S
    yield noted(words, "move more slowly" if calm else remedy)


def composed(rig: RigFile) -> Iterator[Finding]:
    """Check whether one process can run the composed services, and report the disadvantages."""
    services = loop_services()
    for name in rig.rig.composed:
        try:
            shared_timeout_s(rig, [services[one] for one in member_services(name)])
        except plugins.PluginError:
            continue  # reported with the drivers
        except ConfigError as error:
            yield Finding(False, f"composed: {error}", "correct [rig] composed in the rig file")
    having = rig.program_of("actuator")
    if having != "actuator":
        yield noted(
            f"composed: the actuator is part of {having}; if that program hangs or is "
            "killed, only the output's own watchdog makes the arm safe",
            "docs/how-to/compose.md has the disadvantages",
        )


def watchdog(rig: RigFile) -> Finding:
    """Check the output's own behaviour if its host becomes silent."""
    options = options_of(plugins.VOLTAGE_OUTPUTS, rig.output)
    limit_s = getattr(options, "watchdog_s", None)
    if limit_s:
        return Finding(
            True, f"watchdog: the output is safe {limit_s:g} s after the last message from its host"
        )
    on_silence = rig.output.on_silence
    without = "is off (watchdog_s = 0)" if limit_s == 0.0 else f"none in {rig.output.driver}"
    if on_silence == "unstated":
        return Finding(
            False,
            f"watchdog: {without}, and the rig file does not state what the output does if "
            "its host sends nothing: output.on_silence = 'unstated'",
            "find out, and write on_silence = 'safe' or 'holds' into [output]",
        )
    means = "keeps its last voltage" if on_silence == "holds" else "goes to a safe value on its own"
    return noted(f"watchdog: {without}; as the rig file says, the output {means}")


def options_of(group: str, settings: Sensor | Output) -> Table | None:
    """Return a driver's own options with defaults; None if it has no table of them."""
    for name, found in _module(group, settings.driver).items():
        if isinstance(found, type) and issubclass(found, Table) and name.endswith("Options"):
            return read_options(found, settings.driver, settings.options)
    return None


def _module(group: str, name: str) -> dict[str, object]:
    return cast("dict[str, object]", vars(sys.modules[plugins.load(group, name).__module__]))


def limits(rig: RigFile) -> Iterator[Finding]:
    """Check whether the limits allow the use of the rig; voltages at the amplifier's input."""
    for name, service in loop_services().items():
        try:
            service.configure(rig)
        except ConfigError as error:
            yield Finding(False, f"{name}: {error}", "correct what is named in the rig file")
    bears, part, arm = rig.limits, rig.part, rig.model
    span_um = f"{bears.position_min_um:g}..{bears.position_max_um:g} µm"
    reach_um = part.contact_um + bears.force_max_mN / part.stiffness_mN_per_um
    low_um = part.contact_um - part.contact_tolerance_um
    yield Finding(
        bears.position_min_um <= low_um and reach_um <= bears.position_max_um,
        f"limits: the part from {low_um:g} µm, pressed with {bears.force_max_mN:g} mN at "
        f"{reach_um:.1f} µm, position limits {span_um}",
        "correct [part] contact_um, or [limits] force_max_mN or position_max_um",
    )
    yield Finding(
        rig.grip.force_mN < bears.force_max_mN,
        f"limits: a grip presses with {rig.grip.force_mN:g} mN, limit {bears.force_max_mN:g} mN",
        "lower [grip] force_mN, or raise [limits] force_max_mN",
    )
    needed_V = (
        part.contact_um
        + rig.grip.force_mN * (1.0 / part.stiffness_mN_per_um + arm.compliance_um_per_mN)
    ) / arm.piezo_um_per_V
    yield Finding(
        needed_V <= bears.voltage_max_V,
        f"limits: a grip needs about {needed_V:.2f} V, limit {bears.voltage_max_V:g} V",
        "raise [limits] voltage_max_V, if amplifier and arm permit it",
    )
    swing_um = bears.sweep_V * arm.piezo_um_per_V / (2.0 * arm.damping_ratio)
    yield Finding(
        2.0 * swing_um <= bears.position_max_um - bears.position_min_um,
        f"limits: a sweep of ±{bears.sweep_V:g} V moves the arm by ±{swing_um:.1f} µm at its "
        f"resonance, position limits {span_um}",
        "lower [limits] sweep_V",
    )


def model(rig: RigFile) -> Finding:
    """Report quantities of the model that, according to the rig file, were not measured on this
    rig.
    """
    left = [name for name in CALIBRATED if not _given(rig, name)]
    if not left:
        return noted("model: given by the rig file; a calibration may replace each quantity")
    return noted(
        f"model: not in the rig file, therefore assumed: {', '.join(left)}",
        "`pincette job calibrate` measures them, once the rig is running",
    )


def _given(rig: RigFile, name: str) -> bool:
    table, _, quantity = name.partition(".")
    return quantity in getattr(rig, table).model_fields_set
