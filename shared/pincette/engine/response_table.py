"""Table of the free response of a simulated rig, for its rig file.

``python -m pincette.engine.response_table --rig FILE`` moves the arm with the part taken out,
identifies its free response, and prints the table. On hardware, ``pincette job calibrate
free_response`` measures it.
"""

import argparse
import sys
from pathlib import Path

from pincette.config import ConfigError, RecordedFreeResponse, read_rig
from pincette.control.response.identification import Identification
from pincette.control.response.recording import Recording
from pincette.core.files import replace_file
from pincette.core.messages.arms import ARM_PREFIXES
from pincette.engine import teaching

SOURCES = ("identified", "recorded")


def main() -> int:
    """Print the table of each arm of a rig; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m pincette.engine.response_table")
    parser.add_argument("--rig", type=Path, required=True, metavar="FILE", help="rig file")
    parser.add_argument(
        "--write", type=Path, metavar="OUT", help="also write the table to this file"
    )
    parser.add_argument(
        "--source",
        choices=SOURCES,
        default=SOURCES[0],
        help="a model of hysteresis and creep, or the branches as recorded",
    )
    given = parser.parse_args()
    try:
        text = response_tables(given.rig, given.source)
    except (ConfigError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(text)
    if given.write is not None:
        replace_file(given.write, text.encode())
    return 0


def response_tables(path: Path, source: str) -> str:
    """Return the table of each arm of a simulated rig.

    Raises
    ------
    ConfigError
        The rig file cannot be read, or the rig is not simulated.
    ValueError
        The motion does not end, or the model leaves too large a residual.
    """
    file = read_rig(path)
    if file.simulation is None:
        raise ConfigError(
            f"{path} has no [simulation]: on hardware, `pincette job calibrate free_response` "
            "measures the free response"
        )
    text, to_limits = "", file.second is not None
    for prefix, arm in zip(ARM_PREFIXES, file.arms, strict=False):
        if source == "identified":
            found = teaching.teach(arm, to_limits=to_limits)
            table, how = as_toml(found), "fitted"
        else:
            found = teaching.record(arm, to_limits=to_limits)
            table, how = recorded_as_toml(found), "recorded"
        residual_mN = found.residual_um / arm.model.compliance_um_per_mN
        text += (
            f"# residual on motion not {how}: {found.residual_um:.3f} µm r.m.s., as force "
            f"{residual_mN:.2f} mN\n[{prefix}{table[1:]}"
        )
    return text


def as_toml(found: Identification) -> str:
    """Return the table ``[model.free_response]``, with digits according to the residual."""
    model = found.model
    parts = ""
    if model.fadings_per_V:
        parts += f"fadings_per_V = {_array(model.fadings_per_V, 4)}\n"
    if model.return_fadings_per_V:
        parts += f"return_fadings_per_V = {_array(model.return_fadings_per_V, 4)}\n"
    if model.curvature_um_per_V2 != 0.0:
        parts += f"curvature_um_per_V2 = {round(model.curvature_um_per_V2, 4)}\n"
    if model.squares_um_per_V2:
        parts += f"squares_um_per_V2 = {_array(model.squares_um_per_V2, 5)}\n"
        parts += f"cubes_um_per_V3 = {_array(model.cubes_um_per_V3, 5)}\n"
        parts += f"bent_V = {_array(model.bent_V, 4)}\n"
    return (
        "[model.free_response]           # by pincette.engine.response_table\n"
        f"thresholds_V = {_array(model.thresholds_V, 3)}\n"
        f"weights_um_per_V = {_array(model.weights_um_per_V, 4)}\n"
        f"creep_times_s = {_array(model.creep_times_s, 3)}\n"
        f"creep_fractions = {_array(model.creep_fractions, 5)}\n"
        f"{parts}residual_um = {found.residual_um:.3f}\n"
    )


def recorded_as_toml(found: Recording) -> str:
    """Return the table ``[model.recorded_response]``, which replaces ``[model.free_response]``."""
    table = RecordedFreeResponse.from_branches(found.branches, found.residual_um)
    return (
        "[model.recorded_response]       # by pincette.engine.response_table\n"
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


if __name__ == "__main__":
    sys.exit(main())
