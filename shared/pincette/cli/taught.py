"""The free response of a rig, out of a free motion of its arm, as a table of a rig file."""

import sys
from pathlib import Path
from typing import Literal

from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.config import RecordedFreeResponse
from pincette.control.response.identification import Identification
from pincette.control.response.recording import Recording
from pincette.runtime import teaching

Source = Literal["identified", "recorded"]


def teach(path: Path, write: Path | None, source: Source = "identified") -> int:
    """Print the table of a free response, and write it where asked."""
    rig = opened(path)
    if rig.simulation is None:
        raise CliError(
            f"{path} has no [simulation]: teaching on hardware comes with calibration "
            "and is not there yet"
        )
    try:
        found = teaching.teach(rig) if source == "identified" else teaching.record(rig)
    except ValueError as error:
        raise CliError(f"the free response could not be {source}: {error}") from error
    residual_mN = found.residual_um / rig.model.compliance_um_per_mN
    table = as_toml(found) if isinstance(found, Identification) else recorded_as_toml(found)
    sys.stdout.write(
        f"# residual on motion not {'fitted' if source == 'identified' else 'recorded'}: "
        f"{found.residual_um:.3f} µm r.m.s., as force {residual_mN:.2f} mN\n{table}"
    )
    if write is not None:
        write.write_text(table, encoding="utf-8")
    return 0


def as_toml(found: Identification) -> str:
    """Return the table ``[model.free_response]``, rounded to what the residual bears."""
    model = found.model
    parts = ""
    if model.fadings_per_V:
        parts += f"fadings_per_V = {_array(model.fadings_per_V, 4)}\n"
    if model.curvature_um_per_V2 != 0.0:
        parts += f"curvature_um_per_V2 = {round(model.curvature_um_per_V2, 4)}\n"
    return (
        "[model.free_response]           # by `pincette teach`\n"
        f"thresholds_V = {_array(model.thresholds_V, 3)}\n"
        f"weights_um_per_V = {_array(model.weights_um_per_V, 4)}\n"
        f"creep_times_s = {_array(model.creep_times_s, 3)}\n"
        f"creep_fractions = {_array(model.creep_fractions, 5)}\n"
        f"{parts}residual_um = {found.residual_um:.3f}\n"
    )


def recorded_as_toml(found: Recording) -> str:
    """Return the table ``[model.recorded_response]``, which stands in the other's place."""
    table = RecordedFreeResponse.from_branches(found.branches, found.residual_um)
    return (
        "[model.recorded_response]       # by `pincette teach --source recorded`\n"
        f"bottom_V = {round(table.bottom_V, 4)}\n"
        f"bottom_um = {round(table.bottom_um, 3)}\n"
        f"top_V = {round(table.top_V, 4)}\n"
        f"top_um = {round(table.top_um, 3)}\n"
        f"ascending = {_array(table.ascending, 5)}\n"
        f"descending = {_array(table.descending, 5)}\n"
        f"residual_um = {table.residual_um:.3f}\n"
    )


def _array(values: tuple[float, ...], digits: int) -> str:
    return f"[{', '.join(str(round(value, digits)) for value in values)}]"
