"""Residual tables of the model: which one holds for a program, and what becomes of them."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec

from pincette.config import Calibration, FreeResidual, RigFile, calibrated
from pincette.control.planning.program import Program
from pincette.control.record import replace as changed
from pincette_supervisor.plugin.model_in_use import ModelInUse

RESIDUALS = "model.residuals"
MOST_TABLES = 16
"""Largest number of tables in a model; the oldest is dropped."""


def program_digest(program: Program) -> str:
    """Return names a program with its laws, whatever it has learned."""
    bare = changed(program, corrections=None)
    return hashlib.sha256(msgspec.json.encode(bare)).hexdigest()[:16]


def learning_digest(program: Program, rig: RigFile) -> str:
    """Names what a program learns: of its motion, its law, and the free response behind it."""
    text = f"{program_digest(program)} {rig.model.response_digest()}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def motion_digest(program: Program) -> str:
    """Return the digest of the motion of a program.

    Law and stated range are left out: another law plays nearly the same voltages, and the range
    follows from the model and from what is known of the arm's past.
    """
    return program_digest(changed(program, laws=(), planned_range=None))


def table_for(rig: RigFile, program: Program) -> FreeResidual | None:
    """Return the table of a program by the free response in use; None without one."""
    if not rig.model.residuals:
        return None
    digest, response = motion_digest(program), rig.model.response_digest()
    found = (one for one in rig.model.residuals if one.program == digest)
    return next((one for one in found if one.response == response), None)


def armed_with(model: ModelInUse, table: FreeResidual | None) -> ModelInUse:
    """Return the model as it travels with a program: with the table of that program alone."""
    if not model.rig.model.residuals:
        return model
    tables = [] if table is None else [table.model_dump(mode="json")]
    values = {**model.calibration.values, RESIDUALS: tables}
    sources = {**model.calibration.sources}
    if not tables:
        sources.pop(RESIDUALS, None)
    return replace(
        model,
        rig=calibrated(model.rig, Calibration(values={RESIDUALS: tables})),
        calibration=Calibration(values=values, sources=sources),
    )


def merged(
    before: Mapping[str, Any], values: Mapping[str, Any], measured_at: str
) -> dict[str, Any]:
    """Return values to lay over those in use: a table replaces that of its own program alone."""
    if RESIDUALS not in values:
        return dict(values)
    found = [{**one, "measured_at": measured_at} for one in values[RESIDUALS]]
    programs = {one["program"] for one in found}
    kept = [one for one in before.get(RESIDUALS, ()) if one["program"] not in programs]
    tables = sorted([*kept, *found], key=lambda one: one["measured_at"])[-MOST_TABLES:]
    return {**values, RESIDUALS: tables}
