"""The tables of a record, made from the messages that its file holds."""

from pathlib import Path

from pincette.records import folder as files
from pincette.records.bursts import joined
from pincette.records.columns import columns
from pincette.records.mcap_reading import Recording
from pincette.records.timings import loop_timing


def write_tables(folder: Path, recording: Recording) -> list[str]:
    """Write the samples, with acquisition and timing where there is any; returns what is wrong.

    Raises
    ------
    OSError
        Where a file cannot be written.
    """
    try:
        period_s = recording.period_s
    except (KeyError, ValueError):
        return ["the record does not say its control period: no table can be made of it"]
    table = columns(recording.messages, period_s)
    files.write_samples(folder / files.SAMPLES, table, recording.about)
    timing = loop_timing(recording.messages)
    if timing is not None:
        files.write_json(folder / files.TIMING, timing.model_dump(exclude={"silent"}))
    try:
        acquired = joined(recording.messages)
    except ValueError as error:
        return [str(error)]
    if acquired is not None:
        about = {**recording.about, "rate_hz": repr(acquired.rate_hz)}
        files.write_burst(folder / files.BURST, acquired.x_um, acquired.drive_V, about)
    return []
