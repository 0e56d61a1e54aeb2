"""Ratios as they are expected, and which of those found are worse."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

EXPECTED = Path(__file__).with_name("expected.toml")
Kind = Literal["counted", "timed"]


class Expected(BaseModel):
    """One ratio."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: float = Field(gt=0.0)
    noise: float = Field(ge=0.0)
    """By what share of the value it may be worse."""
    better: Literal["higher", "lower"]

    @property
    def limit(self) -> float:
        """The worst that counts as the same."""
        return self.value * (1.0 + (self.noise if self.better == "lower" else -self.noise))

    def holds(self, found: float) -> bool:
        """Whether what was found is within the limit; what is no number is not."""
        return found <= self.limit if self.better == "lower" else found >= self.limit


@dataclass(frozen=True, slots=True)
class Judged:
    """A ratio that was looked for."""

    name: str
    expected: Expected
    found: float | None

    @property
    def holds(self) -> bool:
        """Whether it was found, and within its limit."""
        return self.found is not None and self.expected.holds(self.found)


def expected(kind: Kind, path: Path = EXPECTED) -> dict[str, Expected]:
    """Ratios of a kind; raises ValueError where the file is not in order."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return TypeAdapter(dict[Kind, dict[str, Expected]]).validate_python(tables)[kind]


def judged(wanted: Mapping[str, Expected], found: Mapping[str, float]) -> Iterator[Judged]:
    """Every ratio that is expected, in order."""
    for name, one in wanted.items():
        yield Judged(name, one, found.get(name))
