"""Rig file of a real rig: the questions to the laboratory, and the file generated from the
answers.
"""

import json
import tomllib
from dataclasses import dataclass

from pincette.config.reading import parse_rig
from pincette.config.toml_file import ConfigError

Value = str | float | int | bool


@dataclass(frozen=True, slots=True)
class Question:
    """A question that a laboratory must answer about its rig."""

    name: str
    """Key of the template; the name of the option is the same with dashes."""
    words: str
    unit: str
    default: Value
    where: str
    """Source in which a person finds the value."""

    @property
    def flag(self) -> str:
        """Return the option that sets the answer."""
        return f"--{self.name.replace('_', '-')}"


RIG = (
    Question(
        "name", "name of the rig, in records and at the supervisor", "", "bench", "you choose it"
    ),
    Question(
        "period_s",
        "time between two samples",
        "s",
        0.02,
        "`pincette doctor` reports if it is too short",
    ),
)
SENSOR = (
    Question("sensor_min_um", "lowest reading", "µm", -9999.0, "the measuring range of the head"),
    Question("sensor_max_um", "highest reading", "µm", 9999.0, "the measuring range of the head"),
)
ARM = (
    Question("amplifier_gain", "gain of the amplifier", "V/V", 20.0, "its name plate or manual"),
    Question(
        "arm_min_V", "lowest voltage at the arm", "V", -20.0, "data sheet of its piezo actuator"
    ),
    Question(
        "arm_max_V", "highest voltage at the arm", "V", 80.0, "data sheet of its piezo actuator"
    ),
    Question(
        "free_stroke_um",
        "free stroke of the tip over that range of voltage",
        "µm",
        95.0,
        "data sheet of the arm; 20 % accuracy is enough, `free_response` measures it",
    ),
    Question(
        "compliance_um_per_mN",
        "how far a force at the tip bends the arm",
        "µm/mN",
        0.46,
        "free stroke over blocking force; `compliance` measures it",
    ),
    Question(
        "position_min_um",
        "lowest position of the tip",
        "µm",
        -30.0,
        "range of free motion; the position is 0 at 0 V",
    ),
    Question(
        "position_max_um",
        "highest position of the tip",
        "µm",
        90.0,
        "range of free motion of the arm",
    ),
    Question("force_max_mN", "highest force", "mN", 40.0, "the smaller load limit of arm and part"),
    Question(
        "slew_V_per_s",
        "fastest change of the voltage at the amplifier's input",
        "V/s",
        10.0,
        "the limit of amplifier and arm; a swing of 20 mN takes 1.6 at 0.5 Hz, 16 at 5 Hz",
    ),
    Question(
        "rate_um_per_s",
        "highest speed of the tip along a path",
        "µm/s",
        60.0,
        "you choose it; that swing takes 15 at 0.5 Hz, 145 at 5 Hz",
    ),
    Question(
        "acceleration_um_per_s2",
        "highest acceleration of the tip along a path",
        "µm/s²",
        2000.0,
        "you choose it; that swing takes 51 at 0.5 Hz, 5060 at 5 Hz",
    ),
)
PART = (
    Question("part_name", "the part", "", "glass bead 1400 µm", "a description for people"),
    Question(
        "contact_um",
        "where the arm touches the part first",
        "µm",
        30.0,
        "the gap, seen in the microscope; `contact_stiffness` measures it",
    ),
    Question(
        "contact_tolerance_um",
        "largest error of that position",
        "µm",
        3.0,
        "accuracy of placing the part",
    ),
    Question(
        "stiffness_mN_per_um",
        "stiffness of the part, in series with the passive arm",
        "mN/µm",
        2.17,
        "of the passive arm if the part is harder; `contact_stiffness` measures it",
    ),
    Question("grip_force_mN", "force of a usual grip", "mN", 20.0, "below the highest force"),
)
NUMBERED = (*RIG, *SENSOR, *ARM, *PART)

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
step_V = {step_V} # between two voltages that it can put out; 0: not known
on_silence = {on_silence} # what the hardware does if its host falls silent
{output_options}
[model] # assumed, until calibrations have measured the arm
piezo_um_per_V = {piezo_um_per_V} # free stroke for a volt at the amplifier's input
compliance_um_per_mN = {compliance_um_per_mN} # how far a force at the tip bends the arm

[limits] # voltages at the amplifier's input, gain {gain}
voltage_min_V = {voltage_min_V}
voltage_max_V = {voltage_max_V}
slew_V_per_s = {slew_V_per_s}
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

[track] # a path that is faster is refused
rate_um_per_s = {rate_um_per_s}
acceleration_um_per_s2 = {acceleration_um_per_s2}
"""
COMMENT = " # "
COMMENTS_AT = 36


def bench_file(values: dict[str, Value], options: dict[str, list[str]]) -> str:
    """Return the rig file of a real rig.

    Raises
    ------
    ConfigError
        Gain and voltages give no valid range, or the file could not be read.
    """
    gain = float(values.pop("amplifier_gain"))
    low_V, high_V = float(values.pop("arm_min_V")), float(values.pop("arm_max_V"))
    if not (gain > 0.0 and high_V > low_V):
        raise ConfigError(
            f"a gain of {gain:g} and {low_V:g} V to {high_V:g} V at the arm give no range: "
            "the gain must be above 0, and the highest voltage above the lowest"
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
    aligned = "".join(f"{_aligned(line)}\n" for line in text.splitlines())
    parse_rig(tomllib.loads(aligned))
    return aligned


def _aligned(line: str) -> str:
    """Return a line whose comment is aligned with all other comments."""
    content, mark, comment = line.rpartition(COMMENT)
    return f"{content:<{COMMENTS_AT - 1}}{mark}{comment}" if mark and content else line
