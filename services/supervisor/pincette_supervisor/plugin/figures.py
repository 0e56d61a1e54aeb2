"""Functions that evaluate the samples of a job."""

from pincette_supervisor.plugin.error_sources import draw_sources, sources_of
from pincette_supervisor.plugin.result import (
    PRESSED,
    common,
    course,
    force_error,
    outcome_of,
    position_error,
    stroke_of,
    zero_unconfirmed,
)
from pincette_supervisor.plugin.sample_figures import (
    MOST_MISSING,
    Mask,
    Series,
    chosen,
    largest,
    last,
    last_of,
    mean,
    peak_to_peak,
    percentiles,
    rms,
    series,
    settled,
    within,
)
from pincette_supervisor.plugin.second_arm import table_of_arm

__all__ = [
    "MOST_MISSING",
    "PRESSED",
    "Mask",
    "Series",
    "chosen",
    "common",
    "course",
    "draw_sources",
    "force_error",
    "largest",
    "last",
    "last_of",
    "mean",
    "outcome_of",
    "peak_to_peak",
    "percentiles",
    "position_error",
    "rms",
    "series",
    "settled",
    "sources_of",
    "stroke_of",
    "table_of_arm",
    "within",
    "zero_unconfirmed",
]
