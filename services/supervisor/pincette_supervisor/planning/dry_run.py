"""A plan played by the services of the loop against the arm as the model in use has it."""

from dataclasses import dataclass

from pincette.api.job_kinds import job_kinds
from pincette.api.results import JobResult
from pincette.config import RigFile
from pincette.engine.timing_budget import stated_output
from pincette.records.columns import columns
from pincette_supervisor.planning.identified_arms import (
    IdentifiedArm,
    IdentifiedPair,
    Instruments,
    identified_arm,
    identified_pair,
)
from pincette_supervisor.planning.predicted_samples import Samples
from pincette_supervisor.planning.rig_emulator import RigEmulator
from pincette_supervisor.plugin import Planned, Present, Run
from pincette_supervisor.plugin.functions import functions_of

LONGEST_S, LONGEST_SAMPLES = 120.0, 30_000
"""Limits of the part of a plan that is played, by time and by samples: the shorter one counts."""
ENDLESS_S = 0.3
"""Duration for which a segment without an end is played, as its plan draws it."""


@dataclass(frozen=True, slots=True)
class DryRun:
    """Samples, how the program ended, and why no more of it was played; empty: all of it was."""

    samples: Samples
    outcome: str
    cut: str
    instruments: Instruments
    figures: JobResult | None = None
    """Of two arms: what the samples are evaluated to, as those of a job are."""


def stated_instruments(rig: RigFile) -> Instruments:
    """Delay and lag as the drivers of a rig state them; none where they state nothing."""
    return Instruments(*stated_output(rig))


def run_dry(planned: Planned, present: Present, *, part: bool) -> DryRun:
    """Play a plan from where the arm stands.

    What waits for a person goes on after ``ENDLESS_S``, with the weight hung that is asked for;
    what is held without end is released then.

    Parameters
    ----------
    part
        Whether the part is there, as the rig file or a recipe has it.
    """
    rig = planned.armed.rig
    rig = rig.model_copy(update={"rig": rig.rig.model_copy(update={"time": "lockstep"})})
    instruments, period_s = stated_instruments(rig), rig.rig.period_s
    arm: IdentifiedArm | IdentifiedPair
    if rig.second is not None:
        held = planned.begins_held
        arm = identified_pair(rig, instruments, present, part=part, held=held)
    else:
        arm = identified_arm(rig, instruments, present.stand_V(rig), rig.part if part else None)
        if present.x_um is not None and not planned.begins_held:
            arm = arm.at(present.x_um)
    emulator = RigEmulator(rig, arm, planned.program)
    cut, released = _played(emulator, planned, period_s)
    # The controller leaves open how a hold ends that a person ended.
    otherwise = "released" if released and not cut else "unfinished"
    outcome = emulator.outcome or otherwise
    return DryRun(emulator.samples, outcome, cut, instruments, _figures(planned, rig, emulator))


def _figures(planned: Planned, rig: RigFile, emulator: RigEmulator) -> JobResult | None:
    """Return the result of the predicted samples where the kind shows it; None without samples."""
    kind = job_kinds()[planned.plan.kind]
    shown = kind.figures_in_prediction and rig.second is not None
    if not shown or not emulator.heard or not emulator.samples.t_s:
        return None
    table = columns(emulator.heard, rig.rig.period_s)
    return functions_of(kind).evaluate(Run(rig, planned, table, emulator.heard)).result


def _played(emulator: RigEmulator, planned: Planned, period_s: float) -> tuple[str, bool]:
    """Play to the end; returns why no more was played, and whether a part was released."""
    longest = min(int(LONGEST_S / period_s + 0.5), LONGEST_SAMPLES)
    prompted, released = -1, False
    for seq in range(longest):
        cut = emulator.tick(seq)
        if cut or emulator.ended:
            return cut, released
        segment, told, place = emulator.segment, emulator.told, emulator.place
        if segment is None or told is None:
            continue
        wait = planned.waits.get(place)
        if wait is not None and wait.weight_mN is not None and told.segment_tick <= 1:
            emulator.hang(wait.weight_mN, planned.values.get("arm", 1))
        waited = segment.duration_s is None and told.segment_tick * period_s >= ENDLESS_S
        if waited and place != prompted:
            prompted, released = place, wait is None
            cut = emulator.act("release" if released else "continue")
            if cut:
                return cut, False
    return f"{longest * period_s:g} s are predicted at most", released
