"""The rig file that ``pincette init`` writes."""

import json
import tomllib
from pathlib import Path

from pincette.cli import CliError, Exit
from pincette.config import ConfigError, parse_rig

Value = str | float | int | bool
FORM = """\
# Rig {name}, as `pincette init` wrote it.
# docs/reference/configuration.md lists every key with its unit and its limits.

[rig]
name = {name}
period_s = {period_s} # between two samples; the instruments must answer within it
time = "real"

[sensor]
driver = {sensor}
url = {sensor_url}
minimum_um = {sensor_min_um} # a reading outside this range is invalid
maximum_um = {sensor_max_um}
noise_um = 0.03 # r.m.s., assumed; `noise` measures it
{sensor_options}
[output]
driver = {output}
url = {output_url}
on_silence = {on_silence} # what the hardware does if its host falls silent
{output_options}
[model] # assumed, until calibrations have measured the arm
piezo_um_per_V = {piezo_um_per_V} # free stroke for a volt at the amplifier's input
compliance_um_per_mN = {compliance_um_per_mN} # how far a force at the tip bends the arm

[limits] # voltages at the amplifier's input, gain {gain}
voltage_min_V = {voltage_min_V}
voltage_max_V = {voltage_max_V}
slew_V_per_s = 10.0
position_min_um = {position_min_um}
position_max_um = {position_max_um}
force_max_mN = {force_max_mN}

[part]
name = {part_name}
contact_um = {contact_um} # where the arm touches it first
contact_tolerance_um = {contact_tolerance_um}
stiffness_mN_per_um = {stiffness_mN_per_um} # in series with the passive arm

[grip]
force_mN = {grip_force_mN}
"""
COMMENT = " # "
COMMENTS_AT = 36


def rig_text(values: dict[str, Value], options: dict[str, list[str]]) -> str:
    """The rig file."""
    gain = float(values.pop("amplifier_gain"))
    low_V, high_V = float(values.pop("arm_min_V")), float(values.pop("arm_max_V"))
    if not (gain > 0.0 and high_V > low_V):
        raise CliError(
            f"a gain of {gain:g} and {low_V:g} V to {high_V:g} V at the arm make no range: the "
            "gain is above 0, and the highest voltage above the lowest",
            Exit.USAGE,
        )
    shown = {name: json.dumps(value, ensure_ascii=False) for name, value in values.items()}
    rounded = {
        "voltage_min_V": low_V / gain,
        "voltage_max_V": high_V / gain,
        "piezo_um_per_V": float(values["free_stroke_um"]) / ((high_V - low_V) / gain),
    }
    tables = {
        f"{side}_options": "".join(
            [f"\n[{side}.options]\n", *(f"{line}\n" for line in lines)] if lines else []
        )
        for side, lines in options.items()
    }
    exact = {name: repr(float(f"{value:.6g}")) for name, value in rounded.items()}
    text = FORM.format(**{**shown, **exact, **tables, "gain": f"{gain:g}"})
    return "".join(f"{_aligned(line)}\n" for line in text.splitlines())


def _aligned(line: str) -> str:
    """A line with its comment in the column of all comments."""
    content, mark, comment = line.rpartition(COMMENT)
    return f"{content:<{COMMENTS_AT - 1}}{mark}{comment}" if mark and content else line


def write(path: Path, text: str) -> None:
    """Write a rig file that can be read; nothing is written otherwise."""
    try:
        parse_rig(tomllib.loads(text))
    except (ConfigError, tomllib.TOMLDecodeError) as error:
        raise CliError(f"{error}\nnothing is written: answer anew", Exit.USAGE) from error
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise CliError(f"{path} cannot be written ({error.strerror}): name another") from error
