"""Plan, predicted voltages, result and plot of any calibration."""

from textwrap import shorten

from msgspec.structs import replace

from pincette.api.calibrations import Assumption, CalibrationPlan, CalibrationResult
from pincette.api.plans import PlannedPhase
from pincette.api.predictions import Violation
from pincette.api.states import GOOD_OUTCOMES
from pincette.config import RigFile, derived
from pincette.control.planning.contact_plan import CONTACT_SAMPLES, PlannedRig
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.prediction import require_bounded
from pincette.control.planning.program import Program
from pincette.control.planning.segments import (
    Move,
    PlayedSweep,
    Press,
    Seek,
    Segment,
    voltage_paths,
)
from pincette.records.columns import Columns
from pincette_supervisor.kinds.calibrate import CalibrationRequest
from pincette_supervisor.kinds.calibrate.calibration import (
    functions_of,
    model_of_arm,
    named_of_arm,
    program_for_both,
    run_of_arm,
)
from pincette_supervisor.plugin import (
    ASSUMED,
    UNITS,
    Evaluation,
    Interruption,
    JobFunctions,
    ModelInUse,
    NextJob,
    Planned,
    Present,
    Run,
    drawing,
    value_of,
)
from pincette_supervisor.plugin.drawing import LEFT, MEASURED, Picture, Sheet
from pincette_supervisor.plugin.figures import Series, series
from pincette_supervisor.plugin.laws import rig_law, unstable
from pincette_supervisor.plugin.result import course, outcome_of

SOFTER = 1.5
"""Largest ratio of the compliance of an arm with weights to that in the model in use."""
WIDEST_LOOP = 0.5
"""Width of the hysteresis loop of an arm without a model, as a share of its stroke."""
BEND_SHARE = 0.7
"""If a person has confirmed that there is no part: stiffness below which a kink counts as a bend in
the arm's response, as a fraction of the stiffness of the softest part. The ratio allows for a
hysteresis loop whose slope increases with the motion, so that a part seems softer.
"""
WIDEST = 150
"""Largest number of characters of a statement in the picture."""
BY_HAND = "a person must start it again, since it presses a part"
NO_MORE = "it has been started `tries` times"


def plan(request: CalibrationRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a calibration.

    Raises
    ------
    UnsupportedError
        If the instruments are too slow.
    ValueError
        If the numbers form no program, or one that exceeds a limit of the rig.
    """
    functions = functions_of(request.calibration)
    of_arm = model_of_arm(model, request.arm)
    made, values, waits = functions.program(request, of_arm, present)
    rig = of_arm.rig
    require_bounded([(segment.phase, segment.duration_s or 0.0) for segment in made.segments])
    phases, low_V, high_V = planned_phases(
        made, derived.planned_rig(rig), rig.part.contact_um, rig.safety.safe_V
    )
    weights = "weights" in functions.needs
    made = _guarded(
        made,
        rig,
        weights=weights,
        range_V=high_V - low_V,
        no_part=bool(values.get("no_part")),
    )
    program = program_for_both(made, model.rig, request.arm)
    for number, wait in waits.items():
        phases[number] = phases[number].model_copy(update={"instruction": wait.instruction})
    violations = _violations(made, rig.limits.sweep_V)
    law = rig_law(rig) if functions.meets_part else None
    if law is not None:
        violations += unstable(law.assessment)
    view = CalibrationPlan(
        kind=request.kind,
        calibration=request.calibration,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=phases[-1].start_s + (phases[-1].duration_s or 0.0),
        waits=len(waits),
        phases=phases,
        voltage_min_V=low_V,
        voltage_max_V=high_V,
        violations=violations,
        assumptions=assumptions(request.calibration, of_arm),
        law=None if law is None else law.view(),
    )
    values = {"calibration": request.calibration, "arm": request.arm, **values}
    return Planned(view, program, values, model, waits, meets_part=functions.meets_part)


def _guarded(
    program: Program, rig: RigFile, *, weights: bool, range_V: float, no_part: bool
) -> Program:
    """Add the rig's position limits, since no law enforces them while the voltage moves the arm.

    If no part is expected, add the force limits too. Weights hung by a person are forces, and they
    appear larger on an arm that is softer than in the model in use. As long as no free response is
    calibrated, a straight line replaces it, and a wide hysteresis loop looks like a force.

    The response of some free arms bends as if they were in contact with a soft part, and the
    apparent force grows with the motion. If a person has confirmed ``no_part``, a kink softer than
    the softest part counts as such a bend. The confirmation may be wrong, so an obstacle as hard as
    a part still ends the motion.
    """
    limits, guards, part = rig.limits, program.guards, rig.part
    bend = 0.0
    if no_part:
        bend = BEND_SHARE * part.stiffness_mN_per_um * (1.0 - part.stiffness_tolerance)
    if not any(isinstance(segment, Seek) for segment in program.segments):
        guards = replace(
            guards,
            force_max_mN=limits.force_max_mN * (SOFTER if weights else 1.0)
            + _unknown_loop_mN(rig, range_V),
            contact_force_mN=rig.grip.contact_force_mN,
            contact_samples=CONTACT_SAMPLES,
            bend_mN_per_um=bend,
        )
    guards = replace(
        guards, position_min_um=limits.position_min_um, position_max_um=limits.position_max_um
    )
    return replace(program, guards=guards)


def _unknown_loop_mN(rig: RigFile, range_V: float) -> float:
    """Return the apparent force that an uncalibrated hysteresis loop may cause, in mN; 0 if the
    loop is calibrated.
    """
    model = rig.model
    if model.free_response is not None or model.recorded_response is not None:
        return 0.0
    return WIDEST_LOOP * model.piezo_um_per_V * range_V / model.compliance_um_per_mN


def assumptions(calibration: str, model: ModelInUse) -> list[Assumption]:
    """Return the quantities that a calibration assumes to be known, with their sources."""
    return [
        Assumption(
            quantity=quantity,
            value=value_of(model.rig, quantity),
            unit=UNITS[quantity],
            source=model.calibration.sources.get(quantity, ASSUMED),
        )
        for quantity in functions_of(calibration).assumes
    ]


def _violations(program: Program, sweep_limit_V: float) -> list[Violation]:
    """Return a violation if a sweep's amplitude is too large; all other limits are checked
    earlier."""
    sweeps = (one.sweep for one in program.segments if isinstance(one, PlayedSweep))
    widest_V = max((sweep.amplitude_V for sweep in sweeps), default=0.0)
    if widest_V <= sweep_limit_V:
        return []
    return [
        Violation(
            pointer="/amplitude_V",
            quantity="sweep_amplitude",
            side="above",
            value=widest_V,
            limit=sweep_limit_V,
            unit="V",
            at_s=0.0,
            message=f"amplitude_V = {widest_V:g} V is above the limit of {sweep_limit_V:g} V",
        )
    ]


def evaluate(run: Run) -> Evaluation:
    """Analyse the samples of a completed motion."""
    name, arm = run.planned.values["calibration"], run.planned.values.get("arm", 1)
    analysis, fault = None, ""
    if outcome_of(run.table) in GOOD_OUTCOMES:
        try:
            analysis = functions_of(name).analyse(run_of_arm(run, arm))
            analysis = named_of_arm(analysis, arm)
        except ValueError as error:
            fault = f"no values: {error}"
    resting = assumptions(name, model_of_arm(run.planned.model, arm))
    result = CalibrationResult(
        **course(run.table, period_s=run.period_s, dropped=run.dropped),
        calibration=name,
        values=[] if analysis is None else list(analysis.values),
        figures=[] if analysis is None else list(analysis.figures),
        residuals=None if analysis is None else analysis.residuals,
        statement=fault if analysis is None else analysis.statement,
        warnings=[
            *(() if analysis is None else analysis.warnings),
            *(
                f"depends on {item.quantity}, which is assumed: calibrate it first"
                for item in resting
                if item.source == ASSUMED
            ),
        ],
        assumptions=resting,
    )
    return Evaluation(result, fault, analysis)


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw the measured and the fitted data, and the residuals."""
    result, analysis = evaluation.result, evaluation.analysis
    assert isinstance(result, CalibrationResult)
    sheet, title = Sheet(), result.calibration.replace("_", " ")
    if analysis is None:
        _draw_course(sheet, run.table)
        title += ": no values"
    else:
        functions_of(result.calibration).draw(sheet, analysis.drawn)
    sheet.head(LEFT, title, shorten(result.statement or result.outcome, WIDEST), name)
    return sheet.picture()


def _draw_course(sheet: Sheet, table: Columns) -> None:
    """Draw position and voltage over time, for a calibration that yielded no values."""
    position, voltage = drawing.grid(sheet, 2)
    t_s: Series = series(table, "t_s")
    drawing.prepare(position, "position / µm")
    drawing.line(position, t_s, series(table, "x_um"), MEASURED, "$x$ measured")
    drawing.prepare(voltage, "voltage / V", "time / s")
    drawing.line(voltage, t_s, series(table, "voltage_V"), MEASURED, "$u$ applied")


def goes_on(request: CalibrationRequest, run: Run, why: Interruption) -> NextJob | None:
    """Return how a calibration continues; if it presses a part, a person must start it again."""
    functions = functions_of(request.calibration)
    left: dict[str, object] = {"tries": request.tries - 1, "autostart": True, "queue": False}
    following = request.model_copy(update=left) if request.tries > 1 else None
    if why == "overtravel":
        if functions.moves_less is None or following is None:
            return None
        found = functions.moves_less(following, run)
        return None if found is None else NextJob(found[1], found[0])
    if functions.meets_part:
        return NextJob(BY_HAND)
    if following is None:
        return NextJob(NO_MORE)
    if functions.goes_on is None:
        return NextJob("begins again from its start", following)
    following, words = functions.goes_on(following, run)
    return NextJob(words, following)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, goes_on=goes_on)


def planned_phases(
    program: Program, rig: PlannedRig, contact_um: float, rest_V: float
) -> tuple[list[PlannedPhase], float, float]:
    """Return the phases of a program, its lowest and its highest voltage.

    Parameters
    ----------
    contact_um
        Position where a part is expected, in µm.
    rest_V
        Voltage at which the program begins, in V.
    """

    def pressed_V(force_mN: float) -> float:
        x_um = contact_um + force_mN / program.contact_stiffness_mN_per_um
        return (x_um - rig.x_start_um + rig.compliance_um_per_mN * force_mN) / rig.piezo_um_per_V

    phases: list[PlannedPhase] = []
    start_s, voltage_V = 0.0, rest_V
    low_V = high_V = rest_V
    for segment in program.segments:
        led_V: float | None = None
        if isinstance(segment, Seek):
            led_V = pressed_V(program.guards.contact_force_mN)
        elif isinstance(segment, Press) and segment.to_mN is not None:
            led_V = pressed_V(segment.to_mN)
        elif isinstance(segment, Move) and segment.to_um[0] is not None:
            led_V = (segment.to_um[0] - rig.x_start_um) / rig.piezo_um_per_V
        lowest_V, highest_V, voltage_V = _voltages(segment, voltage_V, led_V)
        low_V, high_V = min(low_V, lowest_V), max(high_V, highest_V)
        phases.append(
            PlannedPhase(
                phase=segment.phase,
                start_s=start_s,
                duration_s=segment.duration_s,
                x_um=None,
                force_mN=None,
                voltage_V=voltage_V,
            )
        )
        start_s += segment.duration_s or 0.0
    return phases, low_V, high_V


def _voltages(segment: Segment, from_V: float, led_V: float | None) -> tuple[float, float, float]:
    """Return lowest, highest and last voltage of a segment.

    ``led_V`` is the final voltage of a segment under a law.
    """
    paths = voltage_paths(segment)
    if paths:
        path, base_V = paths[0], from_V if paths[0].relative else 0.0
        found = peaks(path)
        end_V = base_V + path.at(path.duration_s)
        return base_V + found.lowest, base_V + found.highest, end_V
    if isinstance(segment, PlayedSweep):
        return from_V - segment.sweep.amplitude_V, from_V + segment.sweep.amplitude_V, from_V
    to_V = from_V if led_V is None else led_V
    return min(from_V, to_V), max(from_V, to_V), to_V
