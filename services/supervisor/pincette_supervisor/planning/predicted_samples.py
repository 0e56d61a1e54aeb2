"""Predicted samples, also as JSON, CSV and Parquet with units."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO, StringIO
from typing import Any

from pincette.api.trajectories import SampleColumn
from pincette.core.messages import Applied, Command, Telemetry
from pincette.records import parquet

Answers = tuple[Command, Applied, Telemetry]
"""Messages of the loop that follow one sample: command, output and telemetry."""
COLUMNS = (
    SampleColumn(name="t_s", unit="s", meaning="time since the start"),
    SampleColumn(name="phase", unit="", meaning="phase of the program"),
    SampleColumn(name="x_r_um", unit="µm", meaning="reference position, x_r"),
    SampleColumn(name="force_r_mN", unit="mN", meaning="reference force, F_r"),
    SampleColumn(name="x_um", unit="µm", meaning="position of the tip, predicted"),
    SampleColumn(name="force_mN", unit="mN", meaning="contact force, predicted"),
    SampleColumn(name="voltage_V", unit="V", meaning="voltage applied, predicted"),
    SampleColumn(name="sliding_um", unit="µm", meaning="sliding function, predicted"),
)
SECOND_COLUMNS = (
    SampleColumn(name="second_x_um", unit="µm", meaning="position of the second tip, predicted"),
    SampleColumn(name="second_force_mN", unit="mN", meaning="force of the second arm, predicted"),
    SampleColumn(name="second_voltage_V", unit="V", meaning="second voltage applied, predicted"),
    SampleColumn(name="place_um", unit="µm", meaning="place of the part, predicted"),
    SampleColumn(name="place_r_um", unit="µm", meaning="reference of the place, q_r"),
)


@dataclass(slots=True)
class Samples:
    """Predicted samples as lists of equal length; those of a second arm may be empty."""

    arms: int = 1
    """Number of driven arms."""
    t_s: list[float] = field(default_factory=list[float])
    phase: list[str] = field(default_factory=list[str])
    x_um: list[float] = field(default_factory=list[float])
    force_mN: list[float] = field(default_factory=list[float])
    """Contact force, in mN; compressive forces are positive."""
    asked_V: list[float] = field(default_factory=list[float])
    """Voltage that the controller requests, in V, which the actuator may limit."""
    voltage_V: list[float] = field(default_factory=list[float])
    """Applied voltage, in V."""
    x_r_um: list[float] = field(default_factory=list[float])
    force_r_mN: list[float] = field(default_factory=list[float])
    sliding_um: list[float] = field(default_factory=list[float])
    band_um: list[float] = field(default_factory=list[float])
    second_x_um: list[float] = field(default_factory=list[float])
    second_force_mN: list[float] = field(default_factory=list[float])
    second_asked_V: list[float] = field(default_factory=list[float])
    second_voltage_V: list[float] = field(default_factory=list[float])
    place_um: list[float] = field(default_factory=list[float])
    """Place of the part between two arms, q = (x_1 - x_2)/2, in µm."""
    place_r_um: list[float] = field(default_factory=list[float])
    """Reference of that place, in µm."""

    def of_arms(self) -> "list[Samples]":
        """Return the samples of each arm under the names of a rig with a single arm."""
        if self.arms == 1:
            return [self]
        second = replace(
            self,
            x_um=self.second_x_um,
            force_mN=self.second_force_mN,
            asked_V=self.second_asked_V,
            voltage_V=self.second_voltage_V,
        )
        return [self, second]

    def add(
        self, t_s: float, tips_um: Sequence[float], forces_mN: Sequence[float], told: Answers
    ) -> None:
        """Add a sample: the positions of the arms, and the messages of the services.

        Raises
        ------
        ValueError
            If the services have replied for another number of arms.
        """
        command, applied, view = told
        asked_V = [one.voltage_V for one in command.arms]
        voltages_V = [one.voltage_V for one in applied.arms]
        self.t_s.append(t_s)
        self.phase.append(view.phase)
        self.x_um.append(tips_um[0])
        self.force_mN.append(forces_mN[0])
        self.asked_V.append(asked_V[0])
        self.voltage_V.append(voltages_V[0])
        self.x_r_um.append(view.arms[0].x_r_um)
        self.force_r_mN.append(view.force_r_mN)
        self.sliding_um.append(view.sliding_um)
        self.band_um.append(view.band_um)
        if self.arms == 1:
            return
        if len(asked_V) == 1 or len(voltages_V) == 1 or view.place_r_um is None:
            raise ValueError("the simulated services have replied for one arm only")
        self.second_x_um.append(tips_um[1])
        self.second_force_mN.append(forces_mN[1])
        self.second_asked_V.append(asked_V[1])
        self.second_voltage_V.append(voltages_V[1])
        self.place_um.append(0.5 * (tips_um[0] - tips_um[1]))
        self.place_r_um.append(view.place_r_um)


def columns_of(samples: Samples) -> tuple[SampleColumn, ...]:
    """Return the columns of the samples; two arms have more columns than one."""
    return COLUMNS if samples.arms == 1 else (*COLUMNS, *SECOND_COLUMNS)


def table(samples: Samples) -> dict[str, list[Any]]:
    """Return the columns by name."""
    return {column.name: getattr(samples, column.name) for column in columns_of(samples)}


def as_csv(samples: Samples, about: dict[str, str]) -> bytes:
    """Return a CSV: comments on origin and columns, the column names, and a line for each
    sample."""
    stream = StringIO()
    for name, value in about.items():
        stream.write(f"# {name}: {value}\n")
    for column in columns_of(samples):
        unit = f" [{column.unit}]" if column.unit else ""
        stream.write(f"# {column.name}{unit}: {column.meaning}\n")
    writer = csv.writer(stream, lineterminator="\n")
    columns = table(samples)
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return stream.getvalue().encode()


def as_parquet(samples: Samples, about: dict[str, str]) -> bytes:
    """Return the same columns as Parquet, with their descriptions in the metadata."""
    fields = [
        parquet.Field(
            column.name, column.unit, column.meaning, "text" if column.name == "phase" else "float"
        )
        for column in columns_of(samples)
    ]
    stream = BytesIO()
    parquet.write(stream, fields, table(samples), about)
    return stream.getvalue()
