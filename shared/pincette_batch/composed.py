"""A case played by the composed loop: the same columns, at the pace of the services."""

import numpy as np

from pincette.core.messages import Applied, Estimate, GroundTruth, Telemetry
from pincette.core.wording import applied_text
from pincette.engine.composed import ComposedLoop
from pincette_batch.cases import Case, Run
from pincette_batch.kernel.lane import COLUMNS, Ending

REACHED = ("", "gripped", "tracked", "moved")


def play_composed(case: Case) -> Run:
    """Play a case; ticks that not every service has published are left out at the end."""
    rig, seed = case.rig, case.seed
    if seed is not None and rig.simulation is not None:
        simulation = rig.simulation.model_copy(update={"seed": seed, "truth": True})
        rig = rig.model_copy(update={"simulation": simulation})
    estimates: dict[int, Estimate] = {}
    views: dict[int, Telemetry] = {}
    applied: dict[int, Applied] = {}
    truths: dict[int, GroundTruth] = {}
    outcome = ""
    for message in ComposedLoop(rig).play(case.program):
        if isinstance(message, Estimate):
            estimates[message.seq] = message
        elif isinstance(message, Telemetry):
            views[message.seq] = message
            outcome = message.outcome or outcome
        elif isinstance(message, Applied):
            applied[message.seq] = message
        elif isinstance(message, GroundTruth):
            truths[message.seq] = message
    whole = [seq for seq in views if seq in estimates and seq in applied and seq in truths]
    columns = np.zeros((len(COLUMNS), len(whole)))
    for place, seq in enumerate(whole):
        columns[:, place] = _column(estimates[seq], views[seq], applied[seq], truths[seq])
    tripped = next((applied_text(sample) for sample in applied.values() if sample.cause), "")
    done = outcome in REACHED and not tripped
    phases = tuple(segment.phase for segment in case.program.segments)
    ending = Ending.DONE if done else Ending.OTHERWISE
    return Run(ending, tripped or outcome, columns, phases)


def _column(
    estimate: Estimate, view: Telemetry, applied: Applied, truth: GroundTruth
) -> tuple[float, ...]:
    """One tick, in the order of ``lane.COLUMNS``."""
    return (
        estimate.x_um,
        estimate.force_mN,
        estimate.applied_V,
        truth.x_um,
        truth.force_mN,
        applied.voltage_V,
        view.x_r_um,
        view.force_r_mN,
        view.x_d_um,
        view.sliding_um,
        view.band_um,
        view.residual_um,
        view.perturbation_error_mN,
        view.segment,
        view.contact_stiffness_mN_per_um or 0.0,
    )
