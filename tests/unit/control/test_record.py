"""A record is frozen, and validates itself when it is replaced."""

import dataclasses
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import field, structs

from pincette.control.record import FrozenRecord, field_names, replace


def nothing() -> tuple[int, ...]:
    return ()


class Base(FrozenRecord, frozen=True):
    x_um: float = 1.0
    name: str = "base"


class Derived(Base, frozen=True):
    held: bool = False
    parts: tuple[int, ...] = field(default_factory=nothing)
    inner: Base | None = None


class Checked(FrozenRecord, frozen=True):
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


@dataclasses.dataclass(frozen=True)
class Plain:
    x_um: float
    name: str = "plain"


@given(CHANGES)
def test_replace_gives_the_same_result_as_msgspec_replace(changes: dict[str, Any]) -> None:
    record = Derived(2.0, "derived", True, (1, 2), Base())
    made, wanted = replace(record, **changes), structs.replace(record, **changes)
    assert type(made) is type(wanted) is Derived
    assert made == wanted
    assert hash(made) == hash(wanted)
    assert record == Derived(2.0, "derived", True, (1, 2), Base())


def test_a_dataclass_is_replaced_too() -> None:
    assert replace(Plain(1.0), x_um=2.0) == Plain(2.0)


def test_field_names_are_listed_for_records_and_dataclasses_only() -> None:
    assert field_names(Derived) == ("x_um", "name", "held", "parts", "inner")
    assert field_names(Plain) == ("x_um", "name")
    assert field_names(float) is None


def test_a_record_is_frozen() -> None:
    made: Any = structs.replace(Base(), x_um=2.0)
    with pytest.raises(AttributeError):
        made.x_um = 3.0


def test_a_validated_record_is_validated_on_replacement() -> None:
    with pytest.raises(ValueError, match=r"4\.0 µm, limit 3\.0 µm"):
        structs.replace(Checked(1.0, 3.0), x_um=4.0)


def test_an_unknown_field_is_refused() -> None:
    with pytest.raises(TypeError, match="y_um"):
        replace(Derived(), y_um=1.0)


def test_a_record_can_be_sent_to_another_process() -> None:
    record = Derived(2.0, "derived", True, (1, 2), Base())
    assert pickle.loads(pickle.dumps(record)) == record
