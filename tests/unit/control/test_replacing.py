"""Records are replaced as the standard library does it."""

import dataclasses
from dataclasses import dataclass, field, fields
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.replacing import replace


@dataclass(frozen=True, slots=True)
class Base:
    x_um: float = 1.0
    name: str = "base"


@dataclass(frozen=True, slots=True)
class Derived(Base):
    held: bool = False
    parts: tuple[int, ...] = field(default_factory=tuple)


@dataclass(frozen=True)
class Open:
    x_um: float
    name: str


@dataclass(frozen=True, slots=True)
class Alone:
    x_um: float


@dataclass(frozen=True, slots=True)
class Checked:
    x_um: float
    limit_um: float

    def __post_init__(self) -> None:
        if self.x_um > self.limit_um:
            raise ValueError(f"{self.x_um} µm, limit {self.limit_um} µm")


CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "x_um": st.floats(allow_nan=False),
        "name": st.text(),
        "held": st.booleans(),
        "parts": st.tuples(st.integers()),
    },
)


@given(CHANGES)
def test_fields_are_those_of_the_standard_library(changes: dict[str, object]) -> None:
    record = Derived(2.0, "derived", True, (1, 2))
    made, wanted = replace(record, **changes), dataclasses.replace(record, **changes)
    assert type(made) is Derived
    assert made == wanted
    assert hash(made) == hash(wanted)
    assert record == Derived(2.0, "derived", True, (1, 2))


@pytest.mark.parametrize("record", [Base(), Open(1.0, "open"), Alone(1.0), Checked(1.0, 3.0)])
def test_every_kind_of_record_is_replaced(record: Base | Open | Alone | Checked) -> None:
    made = replace(record, x_um=2.0)
    assert made == dataclasses.replace(record, x_um=2.0)
    assert [getattr(made, item.name) for item in fields(made)][1:] == [
        getattr(record, item.name) for item in fields(record)
    ][1:]


def test_what_is_made_stays_frozen() -> None:
    made: Any = replace(Base(), x_um=2.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.x_um = 3.0


def test_a_record_that_checks_itself_still_does() -> None:
    with pytest.raises(ValueError, match=r"4\.0 µm, limit 3\.0 µm"):
        replace(Checked(1.0, 3.0), x_um=4.0)


@pytest.mark.parametrize("record", [Derived(), Checked(1.0, 3.0)])
def test_an_unknown_field_is_refused(record: Derived | Checked) -> None:
    with pytest.raises(TypeError, match="y_um"):
        replace(record, y_um=1.0)
