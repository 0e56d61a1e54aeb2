"""Whole study: every experiment in order, its report, and a summary in a few numbers."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pincette.config import RigFile, derived
from pincette_study import (
    contact,
    dynamics,
    estimation,
    force_gain,
    gains,
    holding,
    planned_pair,
    precision,
    table_one,
)
from pincette_study.beyond import kilohertz, kilohertz_report
from pincette_study.beyond import report as beyond_report
from pincette_study.beyond import tracks as beyond
from pincette_study.calibrated import prepare
from pincette_study.precision import Trial
from pincette_study.report import Comparison, Section, write_report
from pincette_study.rigs import frozen_rig

Progress = Callable[[str, float], None]
"""Function that receives the present activity and the completed fraction of the whole."""


def run_study(
    base: RigFile,
    folder: Path,
    progress: Progress,
    rigs: int,
    beyond_rigs: int,
    fast: RigFile,
    fast_rigs: int,
    workers: int = 1,
) -> dict[str, Any]:
    """Run every experiment, write the report into a folder, and return its summary.

    Parameters
    ----------
    base
        The demo rig, which provides the values that are not in the paper.
    rigs
        Number of random rigs for the paper's laws.
    beyond_rigs
        Number of rigs of each class of hysteresis for the results beyond the paper.
    fast
        Rig with the instruments and the law for the experiments at its short period.
    fast_rigs
        Number of rigs of each class for these experiments.
    workers
        Number of processes that run closed loops; the results do not depend on it.
    """
    rig = frozen_rig(base)
    progress("teaching the frozen rig", 0.0)
    prepared = prepare(rig)
    taught = prepared.rig
    response = derived.free_response(taught.model)
    sections: list[Section] = []
    progress("Fig. 5: swept sine", 0.02)
    sections.append(dynamics.fig_5(rig))
    progress("Figs. 6 and 7: estimator", 0.06)
    sources = {"the identified response": response, **estimation.other_sources(taught)}
    fig_6, free_mN = estimation.fig_6(taught, sources)
    sections += [fig_6, planned_pair.fig_7(taught, response)]
    progress("Fig. 8: stiffness line", 0.09)
    sections.append(contact.fig_8(taught, response))
    progress("Fig. 9 and Table I: PBSMIC", 0.11)
    table_1, by_K_P = table_one.table_one(taught)
    sections.append(table_1)
    progress("Figs. 10 and 11: DSMIFC", 0.14)
    sections.append(force_gain.force_gain(taught, workers))
    progress("stability map", 0.20)
    sections.append(dynamics.stability(taught))
    progress("gains", 0.30)
    sections.append(gains.search(prepared))
    progress("a minute of hold", 0.33)
    sections.append(holding.long_hold(taught))

    def one_more(done: int) -> None:
        progress(f"random rigs: {done} of {rigs}", 0.36 + 0.12 * done / rigs)

    one_more(0)
    trials = precision.run_trials(base, rigs, one_more, workers)
    sections.append(precision.section(base, trials))

    def one_beyond(done: int) -> None:
        several = beyond_rigs * len(beyond.CLASSES)
        progress(f"beyond the paper: {done} of {several}", 0.48 + 0.30 * done / several)

    one_beyond(0)
    further = beyond.run_beyond(base, beyond_rigs, one_beyond, workers)
    sections += [beyond_report.section(further), beyond_report.grip_section(further)]

    def one_fast(done: int) -> None:
        several = fast_rigs * len(kilohertz.CLASSES)
        progress(f"at 1 kHz: {done} of {several}", 0.78 + 0.20 * done / several)

    one_fast(0)
    quicker = kilohertz.run_kilohertz(base, fast, fast_rigs, one_fast, workers)
    sections.append(kilohertz_report.section(quicker))
    summary = {
        "table1_position_percent": {
            f"{K_P:g}": item.position_percent for K_P, item in by_K_P.items()
        },
        "table1_force_percent": {f"{K_P:g}": item.force_percent for K_P, item in by_K_P.items()},
        "tracking_consistent": precision.summary(trials),
        "tracking_consistent_worst": precision.worst(trials),
        "sensor_floor_percent": precision.sensor_floor_percent(base),
        "estimator_free_rmse_mN": free_mN[estimation.PAPER_SIGNAL],
        "estimator_free_rmse_mN_by_signal": free_mN,
        "random_rigs": rigs,
        "beyond_rigs": beyond_rigs,
        "beyond": {
            **beyond_report.summary(further.tracks),
            "kilohertz": kilohertz_report.summary(quicker),
        },
        "grip": beyond_report.grip_summary(further.grips),
    }
    write_report(folder, [_in_short(sections, trials), *sections], summary)
    progress("done", 1.0)
    return summary


def _in_short(sections: Sequence[Section], trials: Sequence[Trial]) -> Section:
    """Return a summary of confirmed and unconfirmed results, for the start of the report."""
    found = precision.summary(trials)
    rows = [
        Comparison(f"{scheme.upper()} {quantity}", "%", None, values[f"{quantity}_percent"])
        for scheme, values in found.items()
        for quantity in ("position", "force")
    ]
    return Section(
        key="short",
        title="In short",
        text=(
            "The rig is set by Figs. 5 to 8 alone; Table I and Figs. 9 to 11 are predictions. What "
            "the paper reports and whether it comes out here, with the reason where it does not:",
            "The figures below show what both laws reach if plan, units, free response and "
            "gains are in order, as relative RMSE on random rigs (medians) where the "
            "paper's best balance is 6 to 8 %.",
        ),
        comparisons=tuple(rows),
        trends=tuple(trend for section in sections for trend in section.trends),
    )
