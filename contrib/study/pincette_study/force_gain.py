"""Figs. 10 and 11: DSMIFC for several K_f; predictions of the frozen rig."""

from collections.abc import Sequence
from itertools import pairwise

from pincette.config import RigFile
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.dsmifc import LAW as DSMIFC
from pincette.plotting import BLUE, GREEN, Axis, label, legend, picture
from pincette_study import printed
from pincette_study.closed_loop import Errors, Record, Trial, track_all, tracking_plan
from pincette_study.report import Comparison, Picture, Section, Trend
from pincette_study.rigs import simulation_of
from pincette_study.tracked import listed, percent, plain, traces

SWEPT = tuple(value for value in printed.K_F_SWEEP if value <= 5000.0)


def force_gain(rig: RigFile, workers: int = 1) -> Section:
    """Run Figs. 10 and 11: DSMIFC for several K_f, with the paper's plan and a consistent one.

    ``workers`` is the number of processes that play the loops.
    """
    contact = simulation_of(rig).environment_stiffness_mN_per_um
    plans = {
        "mismatched": tracking_plan(rig, stiffness_mN_per_um=printed.PLANNED_STIFFNESS),
        "consistent": tracking_plan(rig, stiffness_mN_per_um=contact),
    }
    trials = {
        (f"{set_name} set, {plan_name} plan", gain): Trial(
            rig, _dsmifc(set_name, gain), plan, identified=plan_name == "consistent"
        )
        for set_name in ("consistent", "printed")
        for plan_name, plan in plans.items()
        for gain in printed.K_F_SWEEP
    }
    cases: dict[str, dict[float, Errors]] = {name: {} for name, _ in trials}
    records: dict[tuple[str, float], Record] = {}
    for (name, gain), found in zip(trials, track_all([*trials.values()], workers), strict=True):
        records[name, gain], cases[name][gain] = found
    fig10 = records["printed set, mismatched plan", 5000.0]
    main = cases["consistent set, mismatched plan"]
    turned = cases["consistent set, consistent plan"]
    old = cases["printed set, mismatched plan"]
    largest = old[5000.0]
    balanced, paper = main[printed.BALANCED_K_F], printed.BALANCED_PERCENT
    return Section(
        key="fig11",
        title="Figs. 10 and 11: DSMIFC by K_f",
        text=(
            "K̃_P = 2, K̃_I = 1. By (51) and (52) the position error rises and the force error falls "
            "with K_f where plan and rig disagree, as they do in Fig. 7(d); where they agree, both "
            "fall, since K_f then only feeds back more.",
        ),
        pictures=(
            Picture("fig10", "Fig. 10 repeated: DSMIFC, printed set, K_f = 5000", traces(fig10)),
            Picture("fig11", "Fig. 11 repeated: errors by K_f", _sweep_picture(cases)),
        ),
        comparisons=(
            Comparison(
                "Fig. 10, largest position error",
                "µm",
                printed.DSMIFC_LARGEST_UM,
                largest.largest_um,
            ),
            Comparison(
                "Fig. 10, largest force error", "mN", printed.DSMIFC_LARGEST_MN, largest.largest_mN
            ),
            percent("position, K_f = 4000", paper, balanced.position_percent, "consistent set"),
            percent("force, K_f = 4000", paper, balanced.force_percent, "consistent set"),
            percent("position, K_f = 4000", paper, old[4000.0].position_percent, "printed set"),
            percent("force, K_f = 4000", paper, old[4000.0].force_percent, "printed set"),
        ),
        trends=(
            _rises(main, "consistent set, plan as in Fig. 7(d)"),
            _falls(main, "force error falls with K_f up to 5000 (consistent set, same plan)"),
            Trend(
                "with a consistent plan the position error reverses and falls",
                _monotone([turned[K_f].position_percent for K_f in SWEPT], -1.0),
                listed([turned[K_f].position_percent for K_f in SWEPT]),
            ),
            _rises(
                old,
                "printed set, same plan",
                "The printed set feeds the contact force through 2.7e6 times too weakly, so its "
                "loop lags by its incremental gain 1/(1 + s_p·K_e) in contact; K_f closes a second "
                "loop around that lag and takes more off the lag than the mismatch adds",
            ),
            _falls(old, "force error falls with K_f up to 5000 (printed set, same plan)"),
            Trend(
                "K_f = 6000 oscillates and makes both errors worse",
                old[6000.0].position_percent > old[5000.0].position_percent
                and old[6000.0].force_percent > old[5000.0].force_percent,
                "At T = 0.02 s the loop of this rig has a wide margin at K_f = 6000; oscillation "
                "there needs a delay or a resonance that Figs. 5 to 8 do not show.",
            ),
        ),
        data={
            name: {f"{K_f:g}": plain(item) for K_f, item in swept.items()}
            for name, swept in cases.items()
        },
    )


def _dsmifc(set_name: str, K_f: float) -> LawSettings:
    return DSMIFC.settings("printed" if set_name == "printed" else "consistent", K_P=2.0, K_f=K_f)


def _rises(swept: dict[float, Errors], where: str, reason: str = "") -> Trend:
    values = [swept[K_f].position_percent for K_f in SWEPT]
    holds = _monotone(values, 1.0)
    why = f". {reason}" if reason and not holds else ""
    return Trend(f"position error rises with K_f up to 5000 ({where})", holds, listed(values) + why)


def _falls(swept: dict[float, Errors], claim: str) -> Trend:
    values = [swept[K_f].force_percent for K_f in SWEPT]
    return Trend(claim, _monotone(values, -1.0), listed(values))


def _monotone(values: Sequence[float], side: float) -> bool:
    return all(side * (after - before) > 0.0 for before, after in pairwise(values))


def _sweep_picture(cases: dict[str, dict[float, Errors]]) -> bytes:
    def draw(axes: list[Axis]) -> None:
        for axis, (name, swept) in zip(axes, cases.items(), strict=True):
            gains = list(swept)
            axis.plot(
                gains,
                [e.position_percent for e in swept.values()],
                "o-",
                color=BLUE,
                label="position",
            )
            axis.plot(
                gains, [e.force_percent for e in swept.values()], "o-", color=GREEN, label="force"
            )
            axis.set_ylim(bottom=0.0)
            label(axis, "$K_f$", "relative RMSE / %", name)
            legend(axis)

    return picture(2, 2, 6.0, draw)
