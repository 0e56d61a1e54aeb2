"""Samples joined by their number into columns: what a record holds, declared once."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pincette.messages import (
    Applied,
    Command,
    Estimate,
    Message,
    Position,
    Sample,
    Telemetry,
    Truth,
)
from pincette.records.parquet import Kind
from pincette.records.truths import number_truths


@dataclass(frozen=True, slots=True)
class Column:
    """One column: where it comes from, its type, its unit and its meaning."""

    name: str
    message: type[Message]
    field: str
    kind: Kind
    unit: str
    meaning: str


COLUMNS = (
    Column("sensor_t_s", Position, "t_s", "float", "s", "the sensor's own time of the sample"),
    Column("x_um", Position, "x_um", "float", "µm", "measured position of the tip, x"),
    Column("position_valid", Position, "valid", "bool", "", "the reading is a measurement"),
    Column("force_mN", Estimate, "force_mN", "float", "mN", "estimated contact force"),
    Column(
        "force_uncertainty_mN", Estimate, "force_uncertainty_mN", "float", "mN", "its uncertainty"
    ),
    Column("perturbation_mN", Estimate, "perturbation_mN", "float", "mN", "estimated perturbation"),
    Column("zero_age_s", Estimate, "zero_age_s", "float", "s", "time since the force was zeroed"),
    Column("estimate_valid", Estimate, "valid", "bool", "", "the estimate may be used"),
    Column("degraded", Estimate, "degraded", "bool", "", "made without the applied voltage"),
    Column("command_V", Command, "voltage_V", "float", "V", "voltage asked for"),
    Column("voltage_V", Applied, "voltage_V", "float", "V", "voltage applied, u"),
    Column("actuator_state", Applied, "state", "text", "", "armed, frozen, ramping, latched, idle"),
    Column("actuator_cause", Applied, "cause", "text", "", "why the actuator tripped"),
    Column("limits_active", Applied, "limits_active", "int", "", "bits: max, min, slew up, down"),
    Column("answered", Applied, "answered", "bool", "", "a command for this tick was taken"),
    Column("command_age_s", Applied, "command_age_s", "float", "s", "age of the command's sample"),
    Column("phase", Telemetry, "phase", "text", "", "phase of the program"),
    Column("segment", Telemetry, "segment", "int", "", "number of the program's segment"),
    Column("segment_tick", Telemetry, "segment_tick", "int", "", "ticks into the segment"),
    Column("x_r_um", Telemetry, "x_r_um", "float", "µm", "reference position, x_r"),
    Column("x_d_um", Telemetry, "x_d_um", "float", "µm", "target of the impedance, x_d"),
    Column("force_r_mN", Telemetry, "force_r_mN", "float", "mN", "reference force, F_r"),
    Column("sliding_um", Telemetry, "sliding_um", "float", "µm", "sliding function, s"),
    Column("band_um", Telemetry, "band_um", "float", "µm", "half width of the band of s"),
    Column(
        "law_perturbation_mN",
        Telemetry,
        "perturbation_mN",
        "float",
        "mN",
        "perturbation by the law's own force",
    ),
    Column(
        "perturbation_error_mN",
        Telemetry,
        "perturbation_error_mN",
        "float",
        "mN",
        "change of the perturbation from one sample to the next",
    ),
    Column("residual_um", Telemetry, "residual_um", "float", "µm", "x minus its prediction"),
    Column("outcome", Telemetry, "outcome", "text", "", "how the program ended"),
    Column("contact_x_um", Telemetry, "contact_x_um", "float", "µm", "position of first touch"),
    Column(
        "contact_stiffness_mN_per_um",
        Telemetry,
        "contact_stiffness_mN_per_um",
        "float",
        "mN/µm",
        "stiffness of what is held",
    ),
    Column("held", Telemetry, "held", "bool", "", "a part is held"),
    Column("paused", Telemetry, "paused", "bool", "", "the references rest, on request"),
    Column("acted", Telemetry, "acted", "text", "", "actions that took effect at this sample"),
    Column("true_x_um", Truth, "x_um", "float", "µm", "simulated rig: true position"),
    Column("true_force_mN", Truth, "force_mN", "float", "mN", "simulated rig: true contact force"),
    Column("true_voltage_V", Truth, "voltage_V", "float", "V", "simulated rig: true voltage"),
)
Columns = Mapping[str, list[Any]]


def columns(messages: Iterable[Message], period_s: float) -> dict[str, list[Any]]:
    """Columns of one epoch; a row for each seq, None where a sample never came.

    The last message of a kind and number counts; what carries a negative seq is no sample, and
    what comes after the actuator has said that the arming is over belongs to nobody. Time is the
    sample's number times the control period.
    """
    found: dict[type[Message], dict[int, Message]] = {}
    truths: list[Truth] = []
    applied: dict[int, Applied] = {}
    for message in messages:
        if isinstance(message, Truth):
            truths.append(message)
        elif isinstance(message, Sample):
            found.setdefault(type(message), {})[message.seq] = message
            if isinstance(message, Applied):
                applied[message.seq] = message
    found[Truth] = dict(number_truths(truths, applied))
    over = last_seq(applied.values())
    numbers = sorted(
        {
            seq
            for samples in found.values()
            for seq in samples
            if seq >= 0 and (over is None or seq <= over)
        }
    )
    table: dict[str, list[Any]] = {"seq": numbers, "t_s": [seq * period_s for seq in numbers]}
    for column in COLUMNS:
        samples = found.get(column.message, {})
        table[column.name] = [
            getattr(samples[seq], column.field) if seq in samples else None for seq in numbers
        ]
    return table


def last_seq(applied: Iterable[Applied]) -> int | None:
    """The sample with which an arming was over; None while it goes on."""
    return min((item.seq for item in applied if item.final and item.seq >= 0), default=None)


def missed(table: Columns) -> int:
    """Numbers between the first and the last sample that never came."""
    numbers = table["seq"]
    return numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0
