"""The kernel's constants, made of a rig file and a program by the makers that the services use."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from pincette.config import ConfigError, RigFile, derived
from pincette.config.laws import resolved_law
from pincette.control.laws import law as control_law
from pincette.control.laws.law import Law
from pincette.control.planning.paths import Path, Point
from pincette.control.planning.program import Program, Segment
from pincette.control.response.play_operators import plays_of
from pincette.control.safety.voltage import ABSURD_SPANS
from pincette.core import plugins
from pincette.sim.instruments.fitting import resolved
from pincette.sim.instruments.keyence_commands import DECIMALS, UM_PER_UNIT
from pincette.sim.plant.drive import drive_constants
from pincette.sim.plant.joined_arms import touchable
from pincette.sim.plant.motion import motion_constants
from pincette.sim.plant.plain_arm import first_touch_um, plain_constants
from pincette.sim.plant.plant import PlantParameters
from pincette.sim.rig.sensor_view import drift_um
from pincette.sim.rig.timeline import Timeline
from pincette.sim.rig.wave import NANOSECONDS
from pincette_batch.compiling import as_record, as_structure
from pincette_batch.kernel.constants import (
    SEGMENT,
    Bench,
    Floats,
    Observer,
    Play,
    Segments,
    Stretch,
)
from pincette_batch.kernel.player import KINDS

WATCHED = ("hold", "settle", "track")
"""Phases in which a part can be lost; as in the controller's ``guarding``."""
SPARE_TICKS = 4
"""For each segment, beyond its time."""


@dataclass(frozen=True, slots=True)
class PreparedRig:
    """A rig as the kernel has it, and as the estimator has it."""

    rig: RigFile
    parameters: PlantParameters
    bench: Bench
    observer: Observer
    constants: tuple[Any, Any]
    """Both of these as a kernel takes them."""
    estimator: Any
    """The service, and"""
    config: Any
    """what it is configured with."""

    @property
    def longest(self) -> int:
        """Substeps of the longest stretch."""
        bench = self.bench
        return max(1, bench.before.substeps, bench.after.substeps)


def prepare_rig(rig: RigFile) -> PreparedRig:
    """Constants of a simulated rig; raises ConfigError where it has no [simulation]."""
    if rig.simulation is None:
        raise ConfigError("[simulation] is missing: this rig file describes a real rig")
    simulation = resolved(rig.simulation, rig.output.driver)
    timeline = Timeline(simulation)
    p, delay_s = timeline.parameters, simulation.actuation_delay_s
    before, before_rest = _stretches(p, delay_s)
    after, after_rest = _stretches(p, rig.rig.period_s - delay_s)
    unit = "mm" if rig.sensor.options.get("unit") == "mm" else "um"
    estimator = plugins.load(plugins.SERVICES, "estimator")
    config = estimator.configure(rig)
    bench = Bench(
        before=before,
        before_rest=before_rest,
        after=after,
        after_rest=after_rest,
        first_touch_um=first_touch_um(p, timeline.state),
        there=touchable(p, timeline.state),
        stiffness_mN_per_um=p.environment_stiffness_mN_per_um,
        output_step_V=p.output_step_V,
        sensor_noise_um=simulation.sensor_noise_um,
        sensor_step_um=simulation.sensor_step_um,
        um_per_unit=UM_PER_UNIT[unit],
        counts_per_unit=float(10 ** DECIMALS[unit]),
        direction=rig.sensor.direction,
        offset_um=rig.sensor.offset_um,
        minimum_um=rig.sensor.minimum_um,
        maximum_um=rig.sensor.maximum_um,
    )
    observer = _observer(config)
    constants = as_structure(bench), as_record(observer)
    return PreparedRig(rig, p, bench, observer, constants, estimator, config)


def _stretches(p: PlantParameters, dt_s: float) -> tuple[Stretch, Stretch]:
    """As ``plant.advance`` cuts a time: whole substeps, and what is left."""
    whole = int(dt_s / p.substep_s + 1e-9)
    rest_s = dt_s - whole * p.substep_s
    return _stretch(p, p.substep_s, whole), _stretch(p, rest_s, 1 if rest_s > 1e-9 else 0)


def _stretch(p: PlantParameters, dt_s: float, count: int) -> Stretch:
    length_s = dt_s if count else p.substep_s
    arms = motion_constants(p, length_s) if p.elaborate else plain_constants(p, length_s)
    return Stretch(drive_constants(p, length_s), arms, count)


def _observer(config: Any) -> Observer:
    model = plays_of(config.response.model, config.period_s)
    return Observer(model, config.compliance_um_per_mN, config.stuck_V)


def law_of(rig: RigFile, program: Program) -> Law:
    """The program's law; raises ValueError where it cannot be made."""
    settings = resolved_law(program.laws[0]) if program.laws else rig.law_settings
    return control_law.build(
        settings,
        rig.model.arm(),
        rig.rig.period_s,
        rig.model.force_filter_s,
        derived.identified_hysteresis(rig.model),
        rig.model.output(rig.rig.period_s),
    )


def play_of(rig: RigFile, program: Program) -> Play:
    """The program and its limits."""
    guards, limits = program.guards, rig.voltage_limits
    room_V = ABSURD_SPANS * (limits.max_V - limits.min_V)
    segments, values, rates = _segments(program.segments, rig.rig.period_s)
    return Play(
        segments=segments,
        values=values,
        rates=rates,
        period_s=rig.rig.period_s,
        planned_mN_per_um=program.contact_stiffness_mN_per_um,
        identifies=program.contact_line == "identified",
        contact_force_mN=guards.contact_force_mN,
        contact_samples=guards.contact_samples,
        force_max_mN=guards.force_max_mN,
        lost_fraction=guards.lost_fraction,
        lost_samples=guards.lost_samples,
        stiffness_min_mN_per_um=guards.stiffness_min_mN_per_um,
        stiffness_max_mN_per_um=guards.stiffness_max_mN_per_um,
        voltage=limits,
        monitors=rig.monitors,
        least_V=limits.min_V - room_V,
        most_V=limits.max_V + room_V,
    )


def most_ticks(program: Program, period_s: float) -> int:
    """No loop that the kernel follows is longer."""
    whole_s = 0.0
    for segment in program.segments:
        whole_s += segment.duration_s or 0.0
    return int(whole_s / period_s) + SPARE_TICKS * len(program.segments)


@lru_cache(maxsize=64)
def _segments(segments: tuple[Segment, ...], period_s: float) -> tuple[Segments, Floats, Floats]:
    """The segments, and values and rates of their paths; made once for laws by the thousand."""
    values, rates = list[float](), list[float]()
    rows = list[tuple[float | bool, ...]]()
    for segment in segments:
        duration_s = segment.duration_s or 0.0
        rows.append(
            (
                KINDS[segment.kind],
                len(values) if segment.path is not None else -1,
                duration_s,
                segment.x_to_um or 0.0,
                segment.force_to_mN or 0.0,
                segment.move_s or duration_s,
                segment.presses,
                segment.phase == "load",
                segment.phase in WATCHED,
                segment.phase == "hold",
            )
        )
        if segment.path is not None:
            ticks = int(duration_s / period_s) + SPARE_TICKS
            points = _points(segment.path, period_s, ticks)
            values += [point.value for point in points]
            rates += [point.rate for point in points]
    # An array of no length has no type of its own.
    return np.array(rows, SEGMENT), np.array(values or [0.0]), np.array(rates or [0.0])


@lru_cache(maxsize=16)
def _points(path: Path, period_s: float, ticks: int) -> list[Point]:
    return [path.point(tick * period_s) for tick in range(ticks)]


def drifts_um(prepared: PreparedRig, ticks: int) -> Floats:
    """Drift of the sensor at each sample."""
    simulation, period_s = prepared.rig.simulation, prepared.rig.rig.period_s
    if simulation is None or (
        simulation.drift.slope_um_per_s == 0.0 and simulation.drift.amplitude_um == 0.0
    ):
        return np.zeros(ticks)
    times_s = [round(tick * period_s * NANOSECONDS) * 1e-9 for tick in range(ticks)]
    return np.array([drift_um(simulation, time_s) for time_s in times_s])
