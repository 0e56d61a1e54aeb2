"""Which loops the kernel follows; the others are played by the composed loop."""

from collections.abc import Iterator

from pincette.config import RigFile
from pincette.config.laws import law_definition
from pincette.control.planning.program import Program, Segment
from pincette.sim.instruments.fitting import resolved
from pincette.sim.plant import plant
from pincette_batch.kernel.player import KINDS

DRIVERS = {"sensor": "keyence_lkg", "output": "icpdas_i7024"}
HIGHEST_V = 10.0
"""That the simulated module puts out."""


def rig_objection(rig: RigFile) -> str:
    """Why the kernel does not follow a rig, whatever it plays; empty where it does."""
    return next(_rig_objections(rig), "")


def program_objection(program: Program) -> str:
    """Why the kernel does not follow a program, on whatever rig; empty where it does."""
    return next(_program_objections(program), "")


def _rig_objections(rig: RigFile) -> Iterator[str]:
    simulation, model, limits = rig.simulation, rig.model, rig.limits
    for table, driver in DRIVERS.items():
        named = rig.sensor.driver if table == "sensor" else rig.output.driver
        if named != driver:
            yield f"{table}.driver = {named!r}, only {driver!r} is followed"
    yield from _law_objections(rig.law.scheme)
    if model.free_response is None:
        yield "the free response is not an identified one"
    if model.residuals:
        yield "a residual table corrects the free response"
    if model.force_observer != "quasi_static" or model.force_ages != "matched":
        yield f"force_observer = {model.force_observer!r} with {model.force_ages} ages"
    if max(abs(limits.voltage_min_V), abs(limits.voltage_max_V)) > HIGHEST_V:
        yield f"limits of the voltage beyond ±{HIGHEST_V} V"
    if simulation is None or not rig.lockstep:
        yield "no simulated rig in lockstep"
    elif simulation.relays is not None:
        yield "the arm has relays, whose turning points no lane can keep"
    elif simulation.averaging_s or simulation.script:
        yield "the sensor averages, or a script acts on the rig"
    elif simulation.part.break_force_mN is not None or simulation.part.lift_after_s is not None:
        yield "the part may fall or break"
    elif simulation.part.slip_force_mN is not None:
        yield "the part may give way"
    else:
        plain = resolved(simulation, rig.output.driver)
        settled_s = plant.settled_s(plant.plant_parameters(plain), plant.start())
        if rig.rig.period_s > settled_s:
            yield f"all comes to rest within a period, {rig.rig.period_s} s"


def _program_objections(program: Program) -> Iterator[str]:
    if program.begins_held or program.capture_hz:
        yield "the program begins with a part, or acquires a burst"
    if program.corrections is not None:
        yield "the program learns from cycle to cycle"
    if len(program.laws) > 1:
        yield f"{len(program.laws)} laws, one is followed"
    for spec in program.laws:
        yield from _law_objections(spec.scheme)
    held = False
    for place, segment in enumerate(program.segments):
        if not _followed(segment, held=held):
            yield f"segment {place} ({segment.phase})"
        held = held or segment.kind == "seek"


def _law_objections(scheme: str) -> Iterator[str]:
    if not law_definition(scheme).compiled:
        yield f"the law {scheme!r} cannot be compiled"


def _followed(segment: Segment, *, held: bool) -> bool:
    """``held``: whether a part has been found before."""
    if segment.kind not in KINDS or segment.zeroes or segment.follows or not segment.duration_s:
        return False
    if segment.kind in ("free", "seek"):
        return segment.x_to_um is not None
    if segment.kind == "force":
        return segment.force_to_mN is not None and held
    return not segment.presses or held
