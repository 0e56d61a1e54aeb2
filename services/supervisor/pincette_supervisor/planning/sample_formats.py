"""Samples that are predicted, as JSON, CSV and Parquet; units go with them in each."""

import csv
from collections.abc import Sequence
from io import BytesIO, StringIO
from typing import Any

from pincette.api.trajectories import SampleColumn
from pincette.records import parquet
from pincette_supervisor.planning.dry_run import DryRun
from pincette_supervisor.planning.predicted_samples import Samples

COLUMNS = (
    SampleColumn(name="t_s", unit="s", meaning="time since the begin"),
    SampleColumn(name="phase", unit="", meaning="phase of the program"),
    SampleColumn(name="x_r_um", unit="µm", meaning="reference position, x_r"),
    SampleColumn(name="force_r_mN", unit="mN", meaning="reference force, F_r"),
    SampleColumn(name="x_um", unit="µm", meaning="position of the tip, predicted"),
    SampleColumn(name="force_mN", unit="mN", meaning="contact force, predicted"),
    SampleColumn(name="voltage_V", unit="V", meaning="voltage applied, predicted"),
    SampleColumn(name="sliding_um", unit="µm", meaning="sliding function, predicted"),
)

SECOND = "second_"
SECOND_COLUMNS = (
    SampleColumn(name="second_x_um", unit="µm", meaning="position of the second tip, predicted"),
    SampleColumn(name="second_force_mN", unit="mN", meaning="force of the second arm, predicted"),
    SampleColumn(name="second_voltage_V", unit="V", meaning="second voltage applied, predicted"),
    SampleColumn(name="place_um", unit="µm", meaning="place of the part, predicted"),
    SampleColumn(name="place_r_um", unit="µm", meaning="reference of the place, q_r"),
)


def columns_of(samples: Samples) -> tuple[SampleColumn, ...]:
    """What is known of each sample, of two arms more than of one."""
    return COLUMNS if samples.second is None else (*COLUMNS, *SECOND_COLUMNS)


def table(samples: Samples) -> dict[str, list[Any]]:
    """Columns by their names."""
    found = {column.name: getattr(samples, column.name) for column in COLUMNS}
    if samples.second is not None:
        for column in SECOND_COLUMNS:
            found[column.name] = getattr(samples.second, column.name.removeprefix(SECOND))
    return found


def as_csv(dry_run: DryRun, about: dict[str, str]) -> bytes:
    """Comments that say whose they are and what each column is, names, a line for each sample."""
    stream = StringIO()
    for name, value in about.items():
        stream.write(f"# {name}: {value}\n")
    told = columns_of(dry_run.samples)
    for column in told:
        unit = f" [{column.unit}]" if column.unit else ""
        stream.write(f"# {column.name}{unit}: {column.meaning}\n")
    writer = csv.writer(stream, lineterminator="\n")
    columns: Sequence[Sequence[Any]] = list(table(dry_run.samples).values())
    writer.writerow([column.name for column in told])
    writer.writerows(zip(*columns, strict=True))
    return stream.getvalue().encode()


def as_parquet(dry_run: DryRun, about: dict[str, str]) -> bytes:
    """The same columns, with what is said of them beside each."""
    fields = [
        parquet.Field(
            column.name, column.unit, column.meaning, "text" if column.name == "phase" else "float"
        )
        for column in columns_of(dry_run.samples)
    ]
    stream = BytesIO()
    parquet.write(stream, fields, table(dry_run.samples), about)
    return stream.getvalue()
