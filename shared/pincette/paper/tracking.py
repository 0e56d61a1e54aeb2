"""Figs. 9 to 11 and Table I: predictions of the frozen rig."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from pincette.config import RigFile
from pincette.control.law import LawSettings, default_settings
from pincette.paper import printed
from pincette.paper.closed_loop import Errors, Record, track, tracking_plan
from pincette.paper.drawing import BLUE, GREEN, ORANGE, Axis, label, legend, picture
from pincette.paper.report import Comparison, Picture, Section, Trend

PLANNED_STIFFNESS = printed.FORCE_PP_MN / printed.X_PP_UM
"""mN/µm of the paper's plan, which is stiffer than the contact."""
SWEPT = tuple(value for value in printed.K_F_SWEEP if value <= 5000.0)


def table_one(rig: RigFile) -> tuple[Section, dict[float, Errors]]:
    """Table I and Fig. 9: PBSMIC with the printed set, by K_P."""
    found: dict[float, Errors] = {}
    records: dict[float, Record] = {}
    plan = tracking_plan(rig, stiffness_mN_per_um=PLANNED_STIFFNESS)
    for gain in printed.TABLE_I:
        settings = replace(default_settings("pbsmic", "printed"), K_P=gain)
        records[gain], found[gain] = track(rig, settings, plan, identified=False)
    position = [item.position_percent for item in found.values()]
    force = [item.force_percent for item in found.values()]
    falls = all(before > after for before, after in pairwise(position))
    rises = all(before < after for before, after in pairwise(force))
    comparisons: list[Comparison] = []
    for gain, row in printed.TABLE_I.items():
        ours = found[gain]
        named = f"K_P = {gain:g}"
        note = f"as estimated {ours.estimated_force_percent:.2f} %"
        comparisons += [
            _percent(f"position, {named}", row.position_percent, ours.position_percent),
            _percent(f"force, {named}", row.force_percent, ours.force_percent, note),
        ]
    largest = found[1.0]
    comparisons += [
        Comparison(
            "Fig. 9, largest position error", "µm", printed.PBSMIC_LARGEST_UM, largest.largest_um
        ),
        Comparison(
            "Fig. 9, largest force error", "mN", printed.PBSMIC_LARGEST_MN, largest.largest_mN
        ),
    ]
    section = Section(
        key="table1",
        title="Table I and Fig. 9: PBSMIC by K_P",
        text=(
            "Printed set, K_I = 1, K_S = 0.003, δ = 100, estimated force fed back as it is, one "
            f"sample late; plan of {PLANNED_STIFFNESS:.2f} mN/µm on a contact of "
            f"{records[1.0].true_stiffness:.2f} mN/µm. Position as measured, force as it truly "
            "was.",
            "Why smaller K_P tracks better: each sample takes the share K_I/(K_P + K_I) off the "
            "error, 1/6 at K_P = 5 and 2/3 at 0.5.",
        ),
        pictures=(
            Picture("fig9", "Fig. 9 repeated: PBSMIC, printed set, K_P = 1", _traces(records[1.0])),
            Picture("table1", "Table I: the paper's errors and ours", _table_picture(found)),
        ),
        comparisons=tuple(comparisons),
        trends=(
            Trend(
                "position error falls with K_P = 5, 2, 1, 0.5",
                falls,
                ", ".join(f"{value:.2f} %" for value in position),
            ),
            Trend(
                "force error rises at the same time",
                rises,
                ", ".join(f"{value:.2f} %" for value in force)
                + (
                    ""
                    if rises
                    else ". On a contact the two errors are tied, F - F_r = K_e·(x - x_r) + "
                    "[K_e·(x_r - x_e) - F_r], so that a smaller position error brings a smaller "
                    "force error, down to the plan's own mismatch in brackets. An error of 1.37 µm "
                    "with one of 0.56 mN, as printed for K_P = 5, would need a mismatch that "
                    "follows the lag of the arm, as an estimated force that leads the true one has."
                ),
            ),
        ),
        data={"by_K_P": {f"{K_P:g}": _plain(item) for K_P, item in found.items()}},
    )
    return section, found


def force_gain(rig: RigFile) -> Section:
    """Figs. 10 and 11: DSMIFC by K_f, with the paper's plan and with a consistent one."""
    contact = rig.simulation.environment_stiffness_mN_per_um if rig.simulation else 0.0
    plans = {
        "mismatched": tracking_plan(rig, stiffness_mN_per_um=PLANNED_STIFFNESS),
        "consistent": tracking_plan(rig, stiffness_mN_per_um=contact),
    }
    cases: dict[str, dict[float, Errors]] = {}
    records: dict[tuple[str, float], Record] = {}
    for set_name in ("consistent", "printed"):
        for plan_name, plan in plans.items():
            name = f"{set_name} set, {plan_name} plan"
            cases[name] = {}
            for gain in printed.K_F_SWEEP:
                settings = _dsmifc(set_name, gain)
                records[name, gain], cases[name][gain] = track(
                    rig, settings, plan, identified=plan_name == "consistent"
                )
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
            Picture("fig10", "Fig. 10 repeated: DSMIFC, printed set, K_f = 5000", _traces(fig10)),
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
            _percent("position, K_f = 4000", paper, balanced.position_percent, "consistent set"),
            _percent("force, K_f = 4000", paper, balanced.force_percent, "consistent set"),
            _percent("position, K_f = 4000", paper, old[4000.0].position_percent, "printed set"),
            _percent("force, K_f = 4000", paper, old[4000.0].force_percent, "printed set"),
        ),
        trends=(
            _rises(main, "consistent set, plan as in Fig. 7(d)"),
            _falls(main, "force error falls with K_f up to 5000 (consistent set, same plan)"),
            Trend(
                "with a consistent plan the position error turns round and falls",
                _monotone([turned[K_f].position_percent for K_f in SWEPT], -1.0),
                _listed([turned[K_f].position_percent for K_f in SWEPT]),
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
            name: {f"{K_f:g}": _plain(item) for K_f, item in swept.items()}
            for name, swept in cases.items()
        },
    )


def _percent(quantity: str, paper: float, ours: float, note: str = "") -> Comparison:
    return Comparison(quantity, "%", paper, ours, note)


def _dsmifc(set_name: str, K_f: float) -> LawSettings:
    start = default_settings("dsmifc", "printed" if set_name == "printed" else "consistent")
    return replace(start, K_P=2.0, K_f=K_f)


def _rises(swept: dict[float, Errors], where: str, reason: str = "") -> Trend:
    values = [swept[K_f].position_percent for K_f in SWEPT]
    holds = _monotone(values, 1.0)
    why = f". {reason}" if reason and not holds else ""
    return Trend(
        f"position error rises with K_f up to 5000 ({where})", holds, _listed(values) + why
    )


def _falls(swept: dict[float, Errors], claim: str) -> Trend:
    values = [swept[K_f].force_percent for K_f in SWEPT]
    return Trend(claim, _monotone(values, -1.0), _listed(values))


def _monotone(values: Sequence[float], side: float) -> bool:
    return all(side * (after - before) > 0.0 for before, after in pairwise(values))


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2f} %" for value in values)


def _plain(item: Errors) -> dict[str, Any]:
    return {name: getattr(item, name) for name in Errors.__slots__}


def _traces(seen: Record) -> bytes:
    def draw(axes: list[Axis]) -> None:
        t = seen.t_s
        axes[0].plot(t, seen.x_um, color=BLUE, label="$x$")
        axes[0].plot(t, seen.x_r_um, color=ORANGE, linestyle="--", label="$x_r$")
        label(axes[0], "", "position / µm")
        legend(axes[0])
        axes[1].plot(t, seen.true_force_mN, color=GREEN, label="$F$ true")
        axes[1].plot(t, seen.force_mN, color=BLUE, linewidth=1.0, label="$F$ estimated")
        axes[1].plot(t, seen.force_r_mN, color=ORANGE, linestyle="--", label="$F_r$")
        label(axes[1], "", "force / mN")
        legend(axes[1])
        axes[2].plot(t, seen.x_um - seen.x_r_um, color=BLUE)
        label(axes[2], "", "position error / µm")
        axes[3].plot(t, seen.true_force_mN - seen.force_r_mN, color=GREEN)
        label(axes[3], "", "force error / mN")
        axes[4].plot(t, seen.voltage_V, color=BLUE)
        label(axes[4], "time / s", "voltage / V")
        axes[5].plot(t, seen.sliding_um, color=BLUE, label="$s$")
        axes[5].fill_between(
            t, -seen.band_um, seen.band_um, color=ORANGE, alpha=0.25, label="band of $s$"
        )
        label(axes[5], "time / s", "sliding / µm")
        legend(axes[5])

    return picture(3, 2, 6.6, draw, sharex=True)


def _table_picture(found: dict[float, Errors]) -> bytes:
    gains = list(found)

    def draw(axes: list[Axis]) -> None:
        for axis, name, title in (
            (axes[0], "position_percent", "position"),
            (axes[1], "force_percent", "force"),
        ):
            paper = [getattr(printed.TABLE_I[K_P], name) for K_P in gains]
            axis.semilogx(gains, paper, "o--", color=ORANGE, label="paper")
            axis.semilogx(
                gains, [getattr(found[K_P], name) for K_P in gains], "o-", color=BLUE, label="here"
            )
            axis.set_ylim(bottom=0.0)
            axis.set_xticks(gains, [f"{K_P:g}" for K_P in gains])
            axis.minorticks_off()
            label(axis, "$K_P$", "relative RMSE / %", title)
            legend(axis)

    return picture(1, 2, 3.4, draw)


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
