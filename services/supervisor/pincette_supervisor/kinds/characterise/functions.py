"""Plan and evaluation of a data sheet."""

from collections.abc import Mapping
from dataclasses import replace
from math import hypot, pi, sqrt
from typing import Any

import numpy as np

from pincette.api.results import ZeroReturn
from pincette.config import RigFile, derived
from pincette.control.calibration.characteristics import (
    CutOff,
    Found,
    Response,
    acting_voltage,
    creep_per_decade,
    cut_off,
    loop_width,
    reach,
    response,
    rms_noise,
    step_response,
)
from pincette.control.calibration.noise import COVERED, sensor_noise
from pincette.control.force.estimation import COVERAGE
from pincette.control.planning.contact_plan import hasty, plan_contact
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.segments import Move, Track
from pincette.core.faults import Phase
from pincette_supervisor.kinds.characterise import (
    CharacteriseJobRequest,
    CharacteriseResult,
    FrequencyPoint,
    Quantity,
    SheetValue,
)
from pincette_supervisor.kinds.characterise.page import plot
from pincette_supervisor.kinds.characterise.program import (
    BRANCH_S,
    CREEP_SHARE,
    Sections,
    sections,
    short_grip,
)
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.kinds.grip import functions as grip
from pincette_supervisor.plugin import (
    ASSUMED,
    Evaluation,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
)
from pincette_supervisor.plugin.figures import Series, series
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    arm_touch,
    conditioning_V,
    contact_job,
    contact_pointer,
    contact_values,
    part_values,
    slowed,
)
from pincette_supervisor.plugin.result import common
from pincette_supervisor.plugin.zero_return import zero_return_of

PRESSED: tuple[str, ...] = ("load", "hold", "settle", "track", "unload")
PAPER: dict[Quantity, float] = {
    "drive_gain": 19.0,
    "force_error": 0.26,
    "contact_stiffness": 2.17,
    "arm_stiffness": 1.0 / 0.46,
    "mode": 388.0,
    "damping": 0.026,
}
"""Values of Q. Xu, IEEE T-ASE 10(3), 2013: sections VI.A and VI.B, Fig. 6(d), (54) and (55)."""
CREEP_FROM_S = 0.3
"""Time after a step from which creep is fitted, in s."""
NOISE_WINDOW_S = 1.0


def plan(request: CharacteriseJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan the free motion and the grip of a data sheet.

    Raises
    ------
    FaultyRequestError
        If the part leaves no room for motion, or the period permits no frequency.
    """
    rig = model.rig
    values = contact_values(request, ("force_mN", *CONTACT_FIELDS), rig)
    force_mN: float = values.pop("force_mN")
    values = slowed(values, request, arm_touch(rig, force_mN, values["contact_force_mN"]))
    begin_um = present.stand_um(rig)
    stated = {
        **values,
        "force_mN": force_mN,
        "noise_s": request.noise_s,
        "grips": request.grips,
        "begin_um": begin_um,
    }
    contact = _contact(stated, rig)
    try:
        found = _sections(stated, rig)
    except ValueError as error:
        raise FaultyRequestError("", str(error)) from error
    planned = derived.planned_rig(rig, begin_um, conditioning_V(request, rig))
    pointers = dict.fromkeys(PRESSED, "/force_mN")
    pressing = [segment for _, segment in found.pressed]
    free = [segment for _, segment in found.free]
    before = (request.grips - 1) * [short_grip(contact, force_mN)]
    made = plan_contact(contact, planned, pressing, pointers, free=free, before=before)
    made = replace(made, violations=(*hasty(contact, planned, force_mN), *made.violations))
    stated["quick_grip_s"] = _quick_grip_s(model, force_mN)
    return contact_job(request, model, made, (0.0, force_mN), stated, present)


def _contact(values: Mapping[str, Any], rig: RigFile) -> ContactRequest:
    return ContactRequest(**{name: values[name] for name in CONTACT_FIELDS}, **part_values(rig))


def _sections(values: Mapping[str, Any], rig: RigFile) -> Sections:
    """Return the sections of a plan with these values; raises ValueError like ``sections``."""
    numbers = (values[name] for name in ("force_mN", "noise_s", "begin_um"))
    return sections(rig, _contact(values, rig), *numbers)


def _quick_grip_s(model: ModelInUse, force_mN: float) -> float | None:
    """Return the planned time of a quick grip up to the hold; None if the rig cannot do one."""
    grip_request = GripJobRequest(
        kind="grip", force_mN=force_mN, profile="quick", condition="never"
    )
    try:
        return grip.plan(grip_request, model, Present()).hold_at_s
    except ValueError:
        return None


class _Samples:
    """Samples of a run by section."""

    def __init__(self, run: Run) -> None:
        rig, program = run.planned.armed.rig, run.planned.program
        self.rig, self.segments = rig, program.segments
        self.found, self.period_s = _sections(run.planned.values, rig), run.period_s
        self._place = series(run.table, "segment")
        names = ("x_um", "x_r_um", "force_mN", "force_r_mN", "force_uncertainty_mN")
        self._columns = {name: series(run.table, name) for name in names}
        applied_V = series(run.table, "voltage_V")
        output = rig.model.output(self.period_s)
        self._columns["voltage_V"] = acting_voltage(applied_V, output, self.period_s)
        self._columns["tick"] = series(run.table, "segment_tick")

    def of(self, section: str, *names: str) -> list[Series]:
        """Return columns of all samples of a section without missing values."""
        return self._at(self.numbers(section), names)

    def numbers(self, section: str) -> list[int]:
        """Return the numbers of the segments of a section."""
        return self.found.numbers(section, len(self.segments))

    def _at(self, numbers: list[int], names: tuple[str, ...]) -> list[Series]:
        columns = [self._columns[name][np.isin(self._place, numbers)] for name in names]
        known = ~np.isnan(np.sum(columns, axis=0))
        return [column[known] for column in columns]

    def each(self, section: str, *names: str) -> list[list[Series]]:
        """Return columns of each segment of a section."""
        return [self._at([number], names) for number in self.numbers(section)]

    def sweep(self) -> list[Response]:
        """Return the response of the free arm, at each frequency."""
        lengths: dict[int, list[int]] = {}
        for number in self.numbers("sweep"):
            half_s = self.segments[number].duration_s or 0.0
            lengths.setdefault(2 * round(half_s / self.period_s), []).append(number)
        return [
            self._response(self._at(numbers, ("x_r_um", "x_um")), length)
            for length, numbers in lengths.items()
        ]

    def force_sweep(self) -> list[Response]:
        """Return the response of the force, at each frequency."""
        found: list[Response] = []
        for number in self.numbers("force sweep"):
            segment = self.segments[number]
            if not isinstance(segment, Track) or segment.force is None:
                continue
            path = segment.force
            tick, *columns = self._at([number], ("tick", "force_r_mN", "force_mN"))
            t_s = (tick - 1.0) * self.period_s
            full = (t_s >= path.full_from_s - 1e-9) & (t_s < path.full_to_s - 1e-9)
            length = round(path.cycle_s / self.period_s)
            found.append(self._response([one[full] for one in columns], length))
        return found

    def _response(self, columns: list[Series], length: int) -> Response:
        reference, x = columns
        whole = len(x) // length * length
        if whole < length:
            raise ValueError("a frequency was not played to its end")
        frequency_hz = 1.0 / (length * self.period_s)
        return response(reference[:whole], x[:whole], frequency_hz, self.period_s)

    def steps(self, section: str, reference: str, name: str) -> Series:
        """Return the mean of the steps up, each from the last sample before the reference moves."""
        courses: list[Series] = []
        numbers = self.numbers(section)
        # A step of the free arm is a move and a rest.
        pairs = isinstance(self.segments[numbers[0]], Move)
        groups = [numbers[i : i + 2] for i in range(0, len(numbers), 2)]
        for group in groups if pairs else [[number] for number in numbers]:
            wanted, x = self._at(group, (reference, name))
            moves = np.flatnonzero(np.abs(wanted - wanted[0]) > 1e-9)
            if len(moves):
                courses.append(x[max(0, int(moves[0]) - 1) :])
        shortest = min(len(course) for course in courses)
        return np.mean([course[:shortest] for course in courses], axis=0)


def evaluate(run: Run) -> Evaluation:
    """Compute the values of the data sheet."""
    result = CharacteriseResult(
        **common(run),
        force_uncertainty_mN=None,
        zero_age_s=None,
        values=[],
        position_response=[],
        force_response=[],
    )
    if "retreat" not in {phase.phase for phase in result.phases} or result.outcome != "gripped":
        return Evaluation(result)
    try:
        samples = _Samples(run)
        position, force = samples.sweep(), samples.force_sweep()
        cut_offs = cut_off(position), cut_off(force)
        values = [
            *_free_values(samples, cut_offs[0]),
            *_force_values(samples, cut_offs[1], result),
            *_zero_return(run),
            *_of_model(run),
        ]
    except (ValueError, IndexError) as error:
        return Evaluation(result, f"no data sheet: {error}")
    stroke = next(value for value in values if value.quantity == "free_stroke")
    reached = [one.frequency_hz.value if one.reached else None for one in cut_offs]
    made: dict[str, Any] = {
        "values": values,
        "position_response": [_point(one) for one in position],
        "force_response": [_point(one) for one in force],
        "free_stroke_um": stroke.value,
        "position_bandwidth_hz": reached[0],
        "force_bandwidth_hz": reached[1],
    }
    return Evaluation(result.model_copy(update=made))


def _point(found: Response) -> FrequencyPoint:
    return FrequencyPoint(
        frequency_hz=found.frequency_hz,
        gain=found.gain,
        gain_uncertainty=COVERAGE * found.gain_uncertainty,
        phase_deg=found.phase_deg,
    )


def _value(
    quantity: Quantity,
    found: Found | float | None,
    unit: str,
    scale: float = 1.0,
    **conditions: float,
) -> SheetValue:
    """Return a measured value; ``scale`` converts it to its unit."""
    value, spread = found if isinstance(found, Found) else (found, None)
    return SheetValue(
        quantity=quantity,
        value=None if value is None else scale * float(value),
        uncertainty=None if spread is None else COVERAGE * scale * float(spread),
        unit=unit,
        source="measured",
        conditions=conditions,
        paper=PAPER.get(quantity),
    )


def _cut_off_values(
    quantities: tuple[Quantity, Quantity], found: CutOff, **conditions: float
) -> list[SheetValue]:
    frequency = found.frequency_hz if found.reached else found.frequency_hz.value
    bandwidth = _value(quantities[0], frequency, "Hz", **conditions)
    if not found.reached:
        bandwidth = bandwidth.model_copy(update={"bound": "above"})
    at = {"frequency_hz": found.frequency_hz.value}
    return [bandwidth, _value(quantities[1], found.phase_deg, "°", **at)]


def _free_values(samples: _Samples, cut: CutOff) -> list[SheetValue]:
    """Return the values of the free arm."""
    found, period_s = samples.found, samples.period_s
    noise_um = samples.rig.sensor.noise_um
    drive, x = (
        column[len(column) // 2 :] for column in samples.of("open loop", "voltage_V", "x_um")
    )
    (open_um,), (closed_um,) = samples.of("open creep", "x_um"), samples.of("closed creep", "x_um")
    creep = _creep("creep_open", open_um, period_s, CREEP_SHARE * reach(drive, x, noise_um).value)
    stroke = reach(drive, x, noise_um, 0.01 * (creep.value or 0.0))
    width = loop_width(drive, x, noise_um)
    range_V = float(np.ptp(drive))
    loop = {"voltage_V": found.free_V, "branch_s": BRANCH_S}
    x_r, y = (column[len(column) // 2 :] for column in samples.of("closed loop", "x_r_um", "x_um"))
    led_um = float(np.ptp(x_r))
    after = loop_width(x_r, y, noise_um)
    (free_mN,) = samples.of("closed loop", "force_mN")
    (noise,) = samples.of("position noise", "x_um")
    rest = sensor_noise(noise, period_s)
    window = round(NOISE_WINDOW_S / period_s)
    short, all_of_it = rms_noise(noise, window), rms_noise(noise, len(noise))
    course = samples.steps("position step", "x_r_um", "x_um")
    step = step_response(course, found.at_um, found.at_um + found.swing_um, period_s, noise_um)
    stepped = {"step_um": found.swing_um, "reference_s": found.step_s}
    at = {"at_um": found.at_um}
    return [
        _value("free_stroke", stroke, "µm", **loop),
        _value("drive_gain", stroke, "µm/V", 1.0 / range_V, **loop),
        _value("hysteresis_open", width, "%", 100.0, stroke_um=stroke.value, branch_s=BRANCH_S),
        _value("hysteresis_closed", after, "%", 100.0, stroke_um=led_um, branch_s=BRANCH_S),
        creep,
        _creep("creep_closed", closed_um, period_s, CREEP_SHARE * led_um),
        _value("position_noise_1_s", short, "µm", window_s=NOISE_WINDOW_S, **at),
        _value("position_noise_all", all_of_it, "µm", window_s=len(noise) * period_s, **at),
        _value(
            "position_resolution",
            Found(rest.resolution_um, COVERED * rest.noise_uncertainty_um),
            "µm",
            **at,
        ),
        *_cut_off_values(
            ("position_bandwidth", "position_phase"), cut, amplitude_um=found.swing_um, **at
        ),
        _value("position_rise", step.rise_s, "s", **stepped),
        _value("position_settling", step.settling_s, "s", band_um=step.band, **stepped),
        _value("position_overshoot", step.overshoot, "%", 100.0, **stepped),
        _value("force_error", float(np.sqrt(np.mean(free_mN**2))), "mN", stroke_um=led_um),
    ]


def _creep(quantity: Quantity, x_um: Series, period_s: float, step_um: float) -> SheetValue:
    """Return the creep after a step, in percent of the step per decade of time."""
    t_s: Series = period_s * np.arange(1, len(x_um) + 1, dtype=np.float64)
    late = t_s >= CREEP_FROM_S
    found = creep_per_decade(t_s[late], x_um[late])
    times = {"from_s": CREEP_FROM_S, "to_s": float(t_s[-1])}
    return _value(quantity, found, "%", 100.0 / step_um, step_um=step_um, **times)


def _force_values(samples: _Samples, cut: CutOff, result: CharacteriseResult) -> list[SheetValue]:
    """Return the values of the pressed part."""
    found, period_s = samples.found, samples.period_s
    (noise,) = samples.of("force noise", "force_mN")
    late = noise[len(noise) // 20 :]
    window = round(NOISE_WINDOW_S / period_s)
    short, all_of_it = rms_noise(late, window), rms_noise(late, len(late))
    at = {"at_mN": found.at_mN}
    before_mN, after_mN = found.at_mN, found.at_mN + 2.0 * found.swing_mN
    course = samples.steps("force step", "force_r_mN", "force_mN")
    step = step_response(course, before_mN, after_mN, period_s, short.value)
    stepped = {"step_mN": 2.0 * found.swing_mN, "reference_s": found.step_s}
    levels = {
        "held full": 2.0 * found.at_mN,
        "force noise": found.at_mN,
        "held quarter": 0.5 * found.at_mN,
    }
    stated = {
        force_mN: float(np.mean(samples.of(section, "force_uncertainty_mN")[0]))
        for section, force_mN in levels.items()
    }
    spread = result.contact_stiffness_error_mN_per_um
    stiffness = result.contact_stiffness_mN_per_um
    contact: Found | float | None = stiffness
    if stiffness is not None and spread is not None:
        contact = Found(stiffness, spread)
    return [
        _value("force_noise_1_s", short, "mN", window_s=NOISE_WINDOW_S, **at),
        _value("force_noise_all", all_of_it, "mN", window_s=len(late) * period_s, **at),
        _value(
            "force_resolution",
            Found(COVERED * short.value, COVERED * short.uncertainty),
            "mN",
            **at,
        ),
        *_cut_off_values(
            ("force_bandwidth", "force_phase"), cut, amplitude_mN=found.swing_mN, **at
        ),
        _value("force_rise", step.rise_s, "s", **stepped),
        _value("force_settling", step.settling_s, "s", band_mN=step.band, **stepped),
        *(
            _value("force_uncertainty", spread_mN, "mN", at_mN=force_mN)
            for force_mN, spread_mN in stated.items()
        ),
        _value("contact_stiffness", contact, "mN/µm", to_mN=2.0 * found.at_mN),
    ]


def _zero_return(run: Run) -> list[SheetValue]:
    """Return mean, scatter and extreme of the force after the returns of the arm; empty if it did
    not return far enough.

    The errors of the model are the same in each grip: a mean does not reduce them.
    """
    place, begin, found = series(run.table, "segment"), 0, list[ZeroReturn]()
    for number, segment in enumerate(run.planned.program.segments):
        if segment.phase == Phase.RETREAT:
            rows = np.flatnonzero((place >= begin) & (place <= number))
            grip = {name: [column[row] for row in rows] for name, column in run.table.items()}
            back = zero_return_of(grip, run.planned.armed.rig)
            found += [] if back is None else [back]
            begin = number + 1
    if not found:
        return []
    forces_mN = np.array([one.force_mN for one in found])
    scatter = rms_noise(forces_mN, len(found)) if len(found) > 1 else Found(0.0, 0.0)
    single_mN = float(np.mean([one.uncertainty_mN for one in found])) / COVERAGE
    mean = Found(float(np.mean(forces_mN)), hypot(single_mN, scatter.value / sqrt(len(found))))
    worst = max(found, key=lambda one: abs(one.force_mN))
    at = {"at_um": float(np.mean([one.x_um for one in found])), "grips": float(len(found))}
    values = [
        _value("zero_return", mean, "mN", **at),
        _value("zero_return_scatter", scatter, "mN", **at),
        _value(
            "zero_return_worst",
            Found(worst.force_mN, worst.uncertainty_mN / COVERAGE),
            "mN",
            **at,
        ),
    ]
    return values if len(found) > 1 else values[:1]


def _of_model(run: Run) -> list[SheetValue]:
    """Return the values of the model in use, found by calibrations or given in the rig file."""
    model = run.planned.model
    arm, quick_s = model.rig.model, run.planned.values.get("quick_grip_s")
    values: list[SheetValue] = []
    frequency = arm.natural_frequency_rad_per_s
    named: tuple[tuple[Quantity, str, float, float, str], ...] = (
        (
            "arm_stiffness",
            "compliance_um_per_mN",
            arm.compliance_um_per_mN,
            1.0 / arm.compliance_um_per_mN,
            "mN/µm",
        ),
        ("mode", "natural_frequency_rad_per_s", frequency, frequency / (2.0 * pi), "Hz"),
        ("damping", "damping_ratio", arm.damping_ratio, arm.damping_ratio, "1"),
    )
    for quantity, member, base, value, unit in named:
        name = f"model.{member}"
        spread = model.uncertainties.get(name)
        found = value if spread is None else Found(value, value * spread / base)
        source = {"source": model.calibration.sources.get(name, ASSUMED)}
        values.append(_value(quantity, found, unit).model_copy(update=source))
    if quick_s is not None:
        planned = _value("grip_time", float(quick_s), "s", force_mN=run.planned.values["force_mN"])
        values.append(planned.model_copy(update={"source": "planned"}))
    return values


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=contact_pointer)
