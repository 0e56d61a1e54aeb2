"""Settings of records in the rig file; a rig file without them is as valid as before."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from pincette.config import ConfigError, parse_rig
from pincette.config.reading import laid_over
from pincette_recorder.config import configure
from tests.support.rigs import DEMO


def _tables(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    tables.pop("recorder")
    return laid_over(tables, changes or {})


def test_records_are_kept_forever_by_default() -> None:
    config = configure(parse_rig(_tables()), Path("data"))
    assert (config.keep_s, config.keep_bytes) == (None, None)
    assert (config.min_free_bytes, config.silence_s) == (200_000_000, 10.0)
    assert config.records == Path("data/jobs")


def test_limits_in_days_and_gigabytes_are_converted_to_seconds_and_bytes() -> None:
    changes = {"recorder": {"keep_days": 2.0, "keep_GB": 1.5}}
    config = configure(parse_rig(_tables(changes)), Path("data"))
    assert (config.keep_s, config.keep_bytes) == (172_800.0, 1_500_000_000)


@pytest.mark.parametrize(
    "table", [{"keep_days": 0.0}, {"keep_GB": -1.0}, {"silence_s": 0.5}, {"keep_weeks": 1.0}]
)
def test_impossible_limits_are_refused(table: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"recorder.{next(iter(table))}"):
        parse_rig(_tables({"recorder": table}))
