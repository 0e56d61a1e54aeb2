"""Samples joined by their number into columns: the content of a record, declared once."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, cast

from msgspec import inspect
from msgspec.structs import replace

from pincette.core.faults import Fault
from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Sample,
    Telemetry,
)
from pincette.core.messages.arms import (
    ArmApplied,
    ArmCommand,
    ArmEstimate,
    ArmPosition,
    ArmTelemetry,
    ArmTruth,
)
from pincette.core.units import unit_of
from pincette.records.message_fields import scalar_of
from pincette.records.parquet import Field, Kind


@dataclass(frozen=True, slots=True)
class Column(Field):
    """A column, with the message and field that it comes from."""

    message: type[Message]
    field: str
    arm: int | None = None
    """Index of the arm whose entry in ``arms`` has the field; None for a field of the message
    itself."""


def _column(
    message: type[Message], name: str, meaning: str, field: str = "", arm: int = 0
) -> Column:
    """Return a column of a message's field, or of an arm's field; by default it has the same
    name.
    """
    field = field or name
    own = field in message.__struct_fields__
    kind = KINDS.get(scalar_of(message if own else ARMS[message], field), "text")
    return Column(name, unit_of(field), meaning, kind, message, field, None if own else arm)


def _of_second(message: type[Message], name: str, meaning: str, field: str) -> Column:
    """Return a column of the second arm, or of the part that both arms hold."""
    return _column(message, name, meaning, field, 1)


KINDS: Mapping[type[inspect.Type], Kind] = {
    inspect.FloatType: "float",
    inspect.IntType: "int",
    inspect.BoolType: "bool",
}
ARMS: Mapping[type[Message], Any] = {
    Position: ArmPosition,
    Estimate: ArmEstimate,
    Command: ArmCommand,
    Applied: ArmApplied,
    Telemetry: ArmTelemetry,
    GroundTruth: ArmTruth,
}
"""Type of the entries in the field ``arms`` of each message."""
COLUMNS = (
    _column(Position, "sensor_t_s", "the sensor's own time of the sample", "t_s"),
    _column(Position, "x_um", "measured position of the tip, x"),
    _column(Position, "position_valid", "the reading is a measurement", "valid"),
    _column(Estimate, "force_mN", "estimated contact force"),
    _column(Estimate, "force_uncertainty_mN", "uncertainty of the force"),
    _column(Estimate, "force_doubt_mN", "part of the uncertainty from a step of the position"),
    _column(Estimate, "perturbation_mN", "estimated perturbation"),
    _column(Estimate, "zero_age_s", "time since the force was zeroed"),
    _column(Estimate, "stroke_change", "change of the stroke since its calibration"),
    _column(Estimate, "stroke_limit", "change that noise and repeatability explain"),
    _column(Estimate, "zero_unconfirmed", "no evidence that no part pressed during the zero"),
    _column(Estimate, "zero_refusal", "code of the reason why a zero was refused or is invalid"),
    _column(Estimate, "estimate_valid", "the estimate may be used", "valid"),
    _column(Estimate, "degraded", "the estimate was made without the applied voltage"),
    _column(Command, "command_V", "commanded voltage", "voltage_V"),
    _column(Applied, "voltage_V", "voltage applied, u"),
    _column(Applied, "actuator_state", "armed, frozen, ramping, latched, idle", "state"),
    _column(Applied, "actuator_cause", "code of the cause of a trip", "cause"),
    _column(Applied, "limits_active", "bits: max, min, slew up, down"),
    _column(Applied, "answered", "a command for this tick was taken"),
    _column(Applied, "command_age_s", "age of the command's sample"),
    _column(Telemetry, "phase", "phase of the program"),
    _column(Telemetry, "segment", "number of the program's segment"),
    _column(Telemetry, "segment_tick", "ticks into the segment"),
    _column(Telemetry, "x_r_um", "reference position, x_r"),
    _column(Telemetry, "x_d_um", "target of the impedance, x_d"),
    _column(Telemetry, "force_r_mN", "reference force, F_r"),
    _column(Telemetry, "correction_um", "learned correction of x_r, within x_d"),
    _column(Telemetry, "sliding_um", "sliding function, s"),
    _column(Telemetry, "band_um", "half width of the band of s"),
    _column(
        Telemetry, "law_perturbation_mN", "perturbation by the law's own force", "perturbation_mN"
    ),
    _column(
        Telemetry,
        "perturbation_error_mN",
        "change of the perturbation from one sample to the next",
    ),
    _column(Telemetry, "residual_um", "x minus its prediction"),
    _column(Telemetry, "outcome", "how the program ended"),
    _column(Telemetry, "contact_x_um", "position of first touch"),
    _column(Telemetry, "contact_stiffness_mN_per_um", "stiffness of what is held"),
    _column(Telemetry, "held", "a part is held"),
    _column(Telemetry, "paused", "the references rest, as requested"),
    _column(Telemetry, "touch_x_um", "position at which the arm met something on a free way"),
    _column(Telemetry, "touch_mN", "force at which it turned back there"),
    _column(Telemetry, "slips", "times that the part has given way"),
    _column(Telemetry, "step_um", "step of the position that the voltage does not explain"),
    _column(Telemetry, "step_x_um", "position just before the step"),
    _column(Telemetry, "step_mN", "force just before the step"),
    _column(Telemetry, "step_after_mN", "force just after the step"),
    _column(Telemetry, "acted", "actions that took effect at this sample"),
    _column(GroundTruth, "true_x_um", "simulated rig: true position", "x_um"),
    _column(GroundTruth, "true_force_mN", "simulated rig: true contact force", "force_mN"),
    _column(GroundTruth, "true_voltage_V", "simulated rig: true voltage", "voltage_V"),
)
SECOND_COLUMNS = (
    _of_second(Position, "second_x_um", "measured position of the second tip, x_2", "x_um"),
    _of_second(Position, "second_position_valid", "the second reading is a measurement", "valid"),
    _of_second(
        Estimate, "second_force_mN", "estimated contact force of the second arm", "force_mN"
    ),
    _of_second(
        Estimate, "second_force_uncertainty_mN", "uncertainty of the force", "force_uncertainty_mN"
    ),
    _of_second(
        Estimate,
        "second_zero_age_s",
        "time since the force of the second arm was zeroed",
        "zero_age_s",
    ),
    _of_second(
        Estimate,
        "second_stroke_change",
        "change of the second arm's stroke since its calibration",
        "stroke_change",
    ),
    _of_second(
        Estimate,
        "second_stroke_limit",
        "change of the second arm's stroke that noise and repeatability explain",
        "stroke_limit",
    ),
    _of_second(
        Estimate,
        "second_zero_unconfirmed",
        "no evidence that no part pressed during the zero of the second arm",
        "zero_unconfirmed",
    ),
    _of_second(
        Estimate,
        "second_zero_refusal",
        "code of the reason why a zero of the second arm was refused or is invalid",
        "zero_refusal",
    ),
    _of_second(Command, "second_command_V", "voltage commanded to the second arm", "voltage_V"),
    _of_second(Applied, "second_voltage_V", "voltage applied to the second arm, u_2", "voltage_V"),
    _of_second(
        Applied,
        "second_limits_active",
        "bits of the second arm: max, min, slew up, down",
        "limits_active",
    ),
    _of_second(Telemetry, "second_x_r_um", "reference position of the second tip", "x_r_um"),
    _of_second(Telemetry, "place_um", "place of the part, q = (x_1 - x_2)/2", "place_um"),
    _of_second(Telemetry, "place_r_um", "reference of the place, q_r", "place_r_um"),
    _of_second(GroundTruth, "true_second_x_um", "simulated rig: true second position", "x_um"),
    _of_second(GroundTruth, "true_second_force_mN", "simulated rig: true second force", "force_mN"),
    _of_second(
        GroundTruth, "true_second_voltage_V", "simulated rig: true second voltage", "voltage_V"
    ),
    _of_second(
        GroundTruth, "true_part_um", "simulated rig: where the first arm touches", "part_um"
    ),
)
"""Additional columns of a rig with two arms."""
Columns = Mapping[str, list[Any]]
RUNNING = ("armed", "idle")
"""States of the actuator in which a simulated rig counts a voltage for each tick."""


def columns(messages: Iterable[Message], period_s: float) -> dict[str, list[Any]]:
    """Return the columns of one epoch up to the end of the arming, one row for each sample number.

    Missing values are None.
    """
    # Of several messages of a type and number, the last is used; a negative seq means that it is
    # not a sample.
    found: dict[type[Message], dict[int, Message]] = {}
    truths: list[GroundTruth] = []
    applied: dict[int, Applied] = {}
    for message in messages:
        if isinstance(message, GroundTruth):
            truths.append(message)
        elif isinstance(message, Sample):
            found.setdefault(type(message), {})[message.seq] = message
            if isinstance(message, Applied):
                applied[message.seq] = message
    found[GroundTruth] = dict(truths_by_tick(truths, applied))
    over = last_seq(applied.values())
    numbers = sorted(
        {
            seq
            for samples in found.values()
            for seq in samples
            if seq >= 0 and (over is None or seq <= over)
        }
    )
    two = any(len(item.arms) > 1 for item in applied.values())
    return table_of(found, numbers, period_s, two=two)


def table_of(
    found: Mapping[type[Message], Mapping[int, Message]],
    numbers: Sequence[int],
    period_s: float,
    *,
    two: bool,
) -> dict[str, list[Any]]:
    """Return columns of samples by type and number, one row for each of ``numbers``.

    ``two`` adds the columns of the second arm.
    """
    table: dict[str, list[Any]] = {"seq": [*numbers], "t_s": [seq * period_s for seq in numbers]}
    rows: dict[tuple[type[Message], int | None], list[Any]] = {}
    for column in (*COLUMNS, *SECOND_COLUMNS) if two else COLUMNS:
        place = column.message, column.arm
        if place not in rows:
            samples = found.get(column.message, {})
            rows[place] = _records((samples.get(seq) for seq in numbers), column.arm)
        value_of = _reader(column)
        table[column.name] = [None if one is None else value_of(one) for one in rows[place]]
    return table


def _records(messages: Iterable[Any], arm: int | None) -> list[Any]:
    """Return these messages, or the entry of one arm in each; None if there is none."""
    if arm is None:
        return [*messages]
    return [
        None if message is None or arm >= len(message.arms) else message.arms[arm]
        for message in messages
    ]


def _reader(column: Column) -> Callable[[Any], Any]:
    """Return the function that reads a column's value from its message or from an arm's entry."""
    read = attrgetter(column.field)
    if column.kind != "text":
        return read  # several times as fast as calling the general function
    return lambda record: _cell(read(record))


def _cell(value: Any) -> Any:
    """Return a value in the form of a column: codes as texts, several separated by a space."""
    if isinstance(value, tuple):
        return " ".join(cast("tuple[str, ...]", value))
    if isinstance(value, Fault):
        return str(value.code)
    return str(value) if isinstance(value, str) else value


def last_seq(applied: Iterable[Applied]) -> int | None:
    """Return the number of the last sample of an arming; None while the arming continues."""
    return min((item.seq for item in applied if item.final and item.seq >= 0), default=None)


def missed(table: Columns) -> int:
    """Return how many numbers between the first and the last sample are missing."""
    numbers = table["seq"]
    return numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0


def truths_by_tick(
    truths: Sequence[GroundTruth], applied: Mapping[int, Applied]
) -> dict[int, GroundTruth]:
    """Return true states by the number of their sample; the first belongs to the first tick."""
    # A simulated rig knows no sample numbers: it counts the voltages that were written to it. In
    # lockstep a voltage is written in every tick; in real time only in ticks with a command. After
    # a trip the number of writes per tick is not fixed, so true states are omitted.
    ticks: list[int] = []
    for seq in range(max(applied, default=-1) + 1):
        if seq in applied and applied[seq].state not in RUNNING:
            break
        ticks.append(seq)
    if not truths or not ticks:
        return {}
    first = min(truth.seq for truth in truths)
    if max(truth.seq for truth in truths) - first + 1 < len(ticks):
        ticks = [seq for seq in ticks if seq not in applied or applied[seq].answered]
    numbers = {first + place: seq for place, seq in enumerate(ticks)}
    return {
        numbers[truth.seq]: replace(truth, seq=numbers[truth.seq])
        for truth in truths
        if truth.seq in numbers
    }


def numbers_every_tick(messages: Iterable[Applied | GroundTruth]) -> bool:
    """Return True if there is a true state for every tick, False if only for ticks with a
    command.
    """
    lowest: int | None = None
    highest, newest, tripped = 0, -1, None
    for message in messages:
        if isinstance(message, GroundTruth):
            lowest = message.seq if lowest is None else min(lowest, message.seq)
            highest = max(highest, message.seq)
            continue
        newest = max(newest, message.seq)
        if message.seq >= 0 and message.state not in RUNNING:
            tripped = message.seq if tripped is None else min(tripped, message.seq)
    ticks = newest + 1 if tripped is None else tripped
    return lowest is None or highest - lowest + 1 >= ticks
