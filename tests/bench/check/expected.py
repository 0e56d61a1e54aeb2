"""Expected ratios, and the decision which measured ones are worse."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

EXPECTED = Path(__file__).with_name("expected.toml")
Kind = Literal["counted", "timed"]


class Expected(BaseModel):
    """An expected ratio."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: float = Field(gt=0.0)
    noise: float = Field(ge=0.0)
    """Share of the value by which a measured ratio may be worse."""
    better: Literal["higher", "lower"]

    @property
    def limit(self) -> float:
        """Worst value that counts as unchanged."""
        return self.value * (1.0 + (self.noise if self.better == "lower" else -self.noise))

    def holds(self, found: float) -> bool:
        """Return whether a measured value is within the limit; NaN is not."""
        return found <= self.limit if self.better == "lower" else found >= self.limit


@dataclass(frozen=True, slots=True)
class Judged:
    """An expected ratio with its measured value."""

    name: str
    expected: Expected
    found: float | None

    @property
    def holds(self) -> bool:
        """Return whether the ratio was measured and is within its limit."""
        return self.found is not None and self.expected.holds(self.found)


def expected(kind: Kind, path: Path = EXPECTED) -> dict[str, Expected]:
    """Read the expected ratios of a kind; raises ValueError if the file is invalid."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return TypeAdapter(dict[Kind, dict[str, Expected]]).validate_python(tables)[kind]


def judged(wanted: Mapping[str, Expected], found: Mapping[str, float]) -> Iterator[Judged]:
    """Compare every expected ratio with its measured value, in the order of the file."""
    for name, one in wanted.items():
        yield Judged(name, one, found.get(name))
