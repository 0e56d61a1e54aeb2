"""The table of the campaign, and whether its targets are met."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

from tests.support.campaign.hysteresis import CLASSES
from tests.support.campaign.treatment import Gripped, Treated

QUIET_UM = 0.05
PEAK_QUIET, PEAK_NOISY = 1.1, 1.2
MOST_WRONG, WIDEST = 0.02, 4.0
EVENTS = ("plain", "stiffness", "restart", "slip", "presses", "gain")


@dataclass(frozen=True)
class Target:
    """One target of the campaign: the measured value and the allowed one."""

    name: str
    found: str
    allowed: str
    met: bool


def peak_limit(treated: Treated) -> float:
    """Return the largest peak force allowed, over the plan."""
    return PEAK_QUIET if treated.drawn.noise_um <= QUIET_UM else PEAK_NOISY


def too_hard(rows: Sequence[Treated]) -> list[Gripped]:
    """Return the grips whose true force was above its limit.

    A part that presses the resting arm harder than the plan already does so before the job begins.
    """
    return [
        grip
        for row in rows
        for grip in row.grips
        if grip.peak_mN > peak_limit(row) * max(grip.wish.force_mN, grip.begin_mN)
    ]


def targets(rows: Sequence[Treated]) -> list[Target]:
    """Judge all rigs."""
    grips = [grip for row in rows for grip in row.grips]
    down = [row for row in rows if row.failed]
    hard, far = too_hard(rows), [grip for grip in grips if grip.beyond]
    wrong = [grip for grip in grips if grip.wrong]
    last = [grip for grip in grips if grip.last_wrong]
    calm = [
        grip
        for grip in grips
        if grip.wish.undisturbed and grip.outcome == "gripped" and grip.error_mN is not None
    ]
    width = float("nan")
    if calm:
        wide = median(grip.uncertainty_mN or 0.0 for grip in calm)
        width = wide / median(abs(grip.error_mN or 0.0) for grip in calm)
    count = len(grips)
    return [
        Target("rigs that could not be brought up", f"{len(down)} of {len(rows)}", "0", not down),
        Target(
            f"true force above {PEAK_QUIET:g} times the plan ({PEAK_NOISY:g} above "
            f"{QUIET_UM:g} µm of noise)",
            f"{len(hard)} of {count}",
            "0",
            not hard,
        ),
        Target("arm beyond its stated range", f"{len(far)} of {count}", "0", not far),
        Target(
            "held force outside U without a mark",
            f"{len(wrong)} of {count}",
            f"{100.0 * MOST_WRONG:g} %",
            len(wrong) <= MOST_WRONG * count,
        ),
        Target(
            "force at the end of the job outside U without a mark",
            f"{len(last)} of {count}",
            f"{100.0 * MOST_WRONG:g} %",
            len(last) <= MOST_WRONG * count,
        ),
        Target(
            "U over the error, medians of undisturbed grips",
            f"{width:.1f}",
            f"{WIDEST:g}",
            width <= WIDEST,
        ),
    ]


def table(rows: Sequence[Treated]) -> str:
    """Return the tables in Markdown: the targets, then grips by what happened."""
    lines = ["| target | found | allowed | met |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {one.name} | {one.found} | {one.allowed} | {'yes' if one.met else 'no'} |"
        for one in targets(rows)
    ]
    lines += [
        "",
        "| what happened | grips | gripped | too hard | beyond range | held outside U | of these "
        "marked | ends outside U |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    hard = too_hard(rows)
    for event in EVENTS:
        grips = [grip for row in rows for grip in row.grips if grip.events == event]
        lines.append(_row(event, grips, hard))
    for kind in CLASSES:
        grips = [grip for row in rows if row.drawn.kind == kind for grip in row.grips]
        lines.append(_row(kind, grips, hard))
    return "\n".join(lines)


def run_page(rows: Sequence[Treated], commit: str, wished: int) -> str:
    """Return the results of a run in Markdown: what was run, the tables, and each miss.

    Parameters
    ----------
    commit
        Commit of the product that was run.
    wished
        Number of rigs that the run was to have.
    """
    seeds = [row.drawn.seed for row in rows]
    lines = [
        f"Commit `{commit}`, seeds {min(seeds)} to {max(seeds)}: {len(rows)} of {wished} rigs.",
        "",
        table(rows),
        "",
        "| class | rigs | brought up |",
        "| --- | --- | --- |",
    ]
    for kind in CLASSES:
        of_kind = [row for row in rows if row.drawn.kind == kind]
        lines.append(f"| {kind} | {len(of_kind)} | {sum(not row.failed for row in of_kind)} |")
    lines += ["", "| rig | what misses a target |", "| --- | --- |"]
    lines += [f"| {row.drawn.label} | {words} |" for row in rows for words in _misses(row)]
    return "\n".join(lines)


def _misses(row: Treated) -> list[str]:
    """Return the missed targets of one rig as text for a cell of a table."""
    hard = too_hard([row])
    grips = [
        grip for grip in row.grips if grip in hard or grip.beyond or grip.wrong or grip.last_wrong
    ]
    found = [row.failed] if row.failed else []
    return [words.replace("|", "/").strip() for words in (*found, *map(str, grips))]


def _row(name: str, grips: Sequence[Gripped], hard: Sequence[Gripped]) -> str:
    def count(judge: Callable[[Gripped], bool]) -> str:
        return str(sum(judge(grip) for grip in grips))

    def outside(grip: Gripped) -> bool:
        return grip.error_mN is not None and abs(grip.error_mN) > (grip.uncertainty_mN or 0.0)

    cells = [
        name,
        str(len(grips)),
        count(lambda grip: grip.outcome == "gripped"),
        count(lambda grip: grip in hard),
        count(lambda grip: bool(grip.beyond)),
        count(outside),
        count(lambda grip: outside(grip) and not grip.wrong),
        count(lambda grip: grip.last_wrong),
    ]
    return f"| {' | '.join(cells)} |"
