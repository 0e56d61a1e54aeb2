"""Data sheet as a picture, as an HTML page and a PDF file of A4 sheets, and as JSON."""

import json
from collections.abc import Mapping
from html import escape
from typing import Any, cast

import numpy as np

from pincette.control.calibration.characteristics import acting_voltage
from pincette.core.units import bare, unit_of
from pincette_supervisor.kinds.characterise import (
    CharacteriseResult,
    FrequencyPoint,
    Quantity,
    SheetValue,
)
from pincette_supervisor.plugin import Evaluation, Run, drawing
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, Axis, Picture, Sheet
from pincette_supervisor.plugin.figures import series

GROUPS: Mapping[str, Mapping[Quantity, str]] = {
    "Free arm": {
        "free_stroke": "Stroke up to the part",
        "drive_gain": "Displacement per volt",
        "hysteresis_open": "Hysteresis, voltage drive",
        "hysteresis_closed": "Hysteresis, closed loop",
        "creep_open": "Creep per decade, voltage drive",
        "creep_closed": "Creep per decade, closed loop",
        "arm_stiffness": "Stiffness of the arm",
        "mode": "First mode",
        "damping": "Damping ratio",
    },
    "Position": {
        "position_noise_1_s": "Noise, r.m.s. within 1 s",
        "position_noise_all": "Noise, r.m.s. over the whole time",
        "position_resolution": "Resolution of a single reading",
        "position_bandwidth": "Bandwidth, −3 dB",
        "position_phase": "Phase there",
        "position_rise": "Rise, 10 % to 90 %",
        "position_settling": "Settling",
        "position_overshoot": "Overshoot",
    },
    "Force": {
        "force_noise_1_s": "Noise, r.m.s. within 1 s",
        "force_noise_all": "Noise, r.m.s. over the whole time",
        "force_resolution": "Resolution of a single sample",
        "force_bandwidth": "Bandwidth, −3 dB",
        "force_phase": "Phase there",
        "force_rise": "Rise, 10 % to 90 %",
        "force_settling": "Settling",
        "force_uncertainty": "Expanded uncertainty",
        "force_error": "R.m.s. force read by the free arm",
        "contact_stiffness": "Stiffness of the contact",
        "zero_return": "Force after the return, mean",
        "zero_return_scatter": "Its standard deviation",
        "zero_return_worst": "Largest force after a return",
        "grip_time": "Quick grip, from start to hold",
    },
}
"""Names of the quantities in order, by section of the sheet."""
CONDITIONS: Mapping[str, str] = {
    "at": "at",
    "to": "up to",
    "amplitude": "amplitude",
    "voltage": "0 to",
    "branch": "each branch",
    "window": "window",
    "band": "band ±",
    "reference": "reference moves in",
    "frequency": "at",
    "force": "to",
}
"""Words before the number of a condition; a condition that is missing here is shown by its own
name."""
WIDTHS = "".join(f'<col style="width: {share}%">' for share in (26, 9, 9, 8, 31, 9, 8))
HEAD = ("quantity", "value", "U (k = 2)", "unit", "condition", "source", "Xu 2013")
PAPER_NOTE = "Xu 2013: Q. Xu, IEEE T-ASE 10(3), 2013; another gripper, at 50 samples per second."
STYLE = """
@page { size: A4; margin: 14mm; }
body { font: 8pt/1.25 system-ui, sans-serif; color: #22282f; max-width: 182mm; margin: 8mm auto; }
h1 { font-size: 14pt; margin: 0 0 1mm; } h2 { font-size: 10pt; margin: 3mm 0 .5mm; }
p { margin: 1mm 0; color: #5a646e; } table { border-collapse: collapse; width: 100%; }
.values { table-layout: fixed; }
th, td { text-align: left; padding: .3mm 2mm .3mm 0; border-bottom: .2mm solid #e3e7eb;
         vertical-align: top; white-space: nowrap; }
thead th { font-weight: 600; border-color: #8a939c; }
thead th:nth-child(2), thead th:nth-child(3), thead th:last-child { text-align: right; }
td.n { text-align: right; font-variant-numeric: tabular-nums; }
td.c { color: #5a646e; font-size: 7.5pt; } td.c:nth-child(5) { white-space: normal; }
th:last-child, td:last-child { padding-right: 0; }
svg { width: 100%; height: auto; } .figures { break-before: page; }
@media screen and (max-width: 182mm) {
  body { margin: 4mm; font-size: 10pt; } td.c { font-size: 9.5pt; }
  .values, .figures { display: block; overflow-x: auto; }
  td.c:nth-child(5) { min-width: 45mm; } .figures svg { min-width: 150mm; }
  table:not(.values) td { white-space: normal; }
}
@media print { body { margin: 0; max-width: none; } }
"""


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Return the data sheet in all file formats; without values, as a picture only."""
    result = cast("CharacteriseResult", evaluation.result)
    sheet = Sheet()
    _figures(sheet, run, result)
    title = "data sheet" if result.values else "no data sheet"
    sheet.head(drawing.LEFT, f"{run.rig.rig.name}: {title}", evaluation.fault, name)
    if not result.values:
        return sheet.picture()
    about = facts(run, name)
    pages = _pdf(sheet, rows(result), about)
    picture = sheet.picture()
    content = {
        "about": about,
        **result.model_dump(mode="json", include={"values", "position_response", "force_response"}),
    }
    files = {
        **picture.vector,
        ".pdf": pages,
        ".html": html(result, about, picture.vector[".svg"].decode()).encode(),
        ".json": json.dumps(content, ensure_ascii=False, indent=2).encode(),
    }
    return Picture(picture.png, files)


def facts(run: Run, name: str) -> dict[str, str]:
    """Return what a sheet states about rig, model, instruments and part."""
    rig, model = run.rig, run.planned.model
    dates = sorted(one.accepted_at for one in model.acceptances.values())
    serials = rig.serial_numbers
    instruments = {
        table: f"{driver}, serial number {serials.get(table) or 'not stated'}"
        for table, driver in (("sensor", rig.sensor.driver), ("output", rig.output.driver))
    }
    return {
        "gripper": run.rig.rig.name,
        "record": name,
        **({"date": run.started_at[:10]} if run.started_at else {}),
        "rate": f"{1.0 / run.period_s:g} samples per second",
        **instruments,
        "part": rig.part.name or "not named",
        "law": run.planned.program.laws[0].scheme,
        "model": f"version {model.version}"
        + (f", last accepted {dates[-1]}" if dates else ", the rig file alone"),
    }


def rows(result: CharacteriseResult) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Return the table by sections of the sheet: for each value, a row of texts in the columns
    of ``HEAD``."""
    return [
        (
            group,
            [
                _row(label, value)
                for quantity, label in labels.items()
                for value in result.values
                if value.quantity == quantity
            ],
        )
        for group, labels in GROUPS.items()
    ]


def _row(label: str, found: SheetValue) -> tuple[str, ...]:
    digits = 3 if found.uncertainty is None else _digits(found.uncertainty)
    value = "–" if found.value is None else _number(found.value, found.uncertainty, digits)
    return (
        label,
        f"> {value}" if found.bound == "above" else value,
        "" if found.uncertainty is None else _number(found.uncertainty, found.uncertainty, digits),
        "" if found.unit == "1" else found.unit,
        ", ".join(_condition(name, value) for name, value in found.conditions.items()),
        found.source,
        "" if found.paper is None else f"{found.paper:.3g}",
    )


def _digits(uncertainty: float) -> int:
    """Return the number of decimals that shows two digits of an uncertainty."""
    return max(0, 1 - int(np.floor(np.log10(uncertainty)))) if uncertainty > 0.0 else 3


def _number(value: float, uncertainty: float | None, digits: int) -> str:
    text = f"{value:.3g}" if uncertainty is None else f"{value:.{min(digits, 5)}f}"
    return text.replace("-", "−")


def _condition(name: str, value: float) -> str:
    word = bare(name)
    return f"{CONDITIONS.get(word, word)} {value:.3g} {unit_of(name)}".rstrip()


def html(result: CharacteriseResult, about: Mapping[str, str], svg: str) -> str:
    """Return the sheet as a page that needs no other file and prints on A4."""
    head = "".join(f"<th>{escape(name)}</th>" for name in HEAD)
    parts: list[str] = []
    for group, lines in rows(result):
        body = "".join(f"<tr>{_cells(line)}</tr>" for line in lines)
        parts.append(
            f'<h2>{escape(group)}</h2><table class="values">{WIDTHS}<thead><tr>{head}</tr></thead>'
            f"<tbody>{body}</tbody></table>"
        )
    stated = "".join(
        f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>" for key, text in about.items()
    )
    drawn = svg[svg.index("<svg") :]
    title = f"Data sheet · {about['gripper']}"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<table>{stated}</table>\n{''.join(parts)}\n"
        f'<p>{escape(PAPER_NOTE)}</p>\n<div class="figures">{drawn}</div>\n</body>\n</html>\n'
    )


def _cells(line: tuple[str, ...]) -> str:
    label, value, spread, unit, condition, source, paper = map(escape, line)
    return (
        f'<td>{label}</td><td class="n">{value}</td><td class="n">{spread}</td><td>{unit}</td>'
        f'<td class="c">{condition}</td><td class="c">{source}</td><td class="n">{paper}</td>'
    )


HELD = ("hold", "settle", "track")
"""Phases in which the law holds a force."""


def _figures(sheet: Sheet, run: Run, result: CharacteriseResult) -> None:
    """Draw loops, responses and the force over position."""
    table = run.table
    axes = drawing.grid(sheet, 3, 2)
    phase = np.array(table["phase"], dtype=object)
    x_um, x_r_um, force_mN = (series(table, name) for name in ("x_um", "x_r_um", "force_mN"))
    output = run.rig.model.output(run.period_s)
    at_arm_V = acting_voltage(series(table, "voltage_V"), output, run.period_s)
    error_um, error_mN = x_um - x_r_um, force_mN - series(table, "force_r_mN")
    free, led = phase == "condition", phase == "follow"
    free &= ~np.maximum.accumulate(led)  # without the strokes before each grip
    loaded, held = (np.isin(phase, names) for names in (("load", "unload"), HELD))
    held &= np.maximum.accumulate(phase == "hold")  # the last grip alone
    drawn = (
        (axes[0], "position / µm", "voltage / V", at_arm_V[free], x_um[free]),
        (axes[1], "$x - x_r$ / µm", "reference / µm", x_r_um[led], error_um[led]),
        (axes[4], "force / mN", "position / µm", x_um[loaded], force_mN[loaded]),
        (axes[5], "$F - F_r$ / mN", "time / s", series(table, "t_s")[held], error_mN[held]),
    )
    for axis, y_label, x_label, x, y in drawn:
        drawing.prepare(axis, y_label, x_label)
        drawing.line(axis, x, y, MEASURED, "", width=0.8)
    _response(axes[2], axes[3], result.position_response, MEASURED, "position, free")
    _response(axes[2], axes[3], result.force_response, REFERENCE, "force, held")
    axes[2].axhline(-3.0, color=drawing.FAINT, linewidth=0.7)
    if result.values:
        axes[2].legend(loc="center left", fontsize=8.5, frameon=False, labelcolor=drawing.INK)


def _response(
    gain: Axis, phase: Axis, points: list[FrequencyPoint], color: str, label: str
) -> None:
    at: list[float] = [one.frequency_hz for one in points]
    drawing.prepare(gain, "gain / dB", "frequency / Hz")
    drawing.prepare(phase, "phase / °", "frequency / Hz")
    style: dict[str, Any] = {"color": color, "marker": "o", "markersize": 3.0, "linewidth": 1.0}
    if points:
        decibels = [20.0 * float(np.log10(one.gain)) for one in points]
        gain.plot(at, decibels, label=label, **style)
        phase.plot(at, [one.phase_deg for one in points], **style)
        gain.set_xscale("log")
        phase.set_xscale("log")


COLUMNS = (0.07, 0.37, 0.45, 0.47, 0.53, 0.81, 0.95)
"""Horizontal positions of the table's columns on a PDF page; numbers are aligned at their right
end."""
ENDS = (1, 2, 6)


def _pdf(
    sheet: Sheet, parts: list[tuple[str, list[tuple[str, ...]]]], about: Mapping[str, str]
) -> bytes:
    """Return an A4 page with the table and a page with the figures, without a time stamp."""
    first_page = Sheet(drawing.A4_IN)
    page = first_page.figure
    title = f"Data sheet · {about['gripper']}"
    page.text(0.07, 0.955, title, fontsize=12, weight="bold", color=drawing.INK)
    y = 0.935
    for key, text in about.items():
        page.text(0.07, y, key, fontsize=7, color=drawing.FAINT)
        page.text(0.17, y, text, fontsize=7, color=drawing.INK)
        y -= 0.014
    for group, lines in parts:
        y -= 0.012
        for line in ((group, *HEAD[1:]), *lines):
            first = line[0] == group
            for place, (at, text) in enumerate(zip(COLUMNS, line, strict=True)):
                page.text(
                    at,
                    y,
                    text,
                    fontsize=5.5 if place in (4, 5) and not first else 7,
                    ha="right" if place in ENDS else "left",
                    weight="bold" if first else "normal",
                    color=drawing.INK,
                )
            y -= 0.0165
    page.text(0.07, 0.03, PAPER_NOTE, fontsize=6.5, color=drawing.FAINT)
    return drawing.pdf([first_page, sheet])
