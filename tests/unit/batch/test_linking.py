"""Functions are compiled as they stand: same bits, dataclasses and keywords included."""

from dataclasses import dataclass
from math import expm1
from typing import NamedTuple

import pytest

from pincette_batch.compiling import (
    CompilerMissingError,
    as_record,
    as_structure,
    compiled,
    record_type,
)
from pincette_batch.compiling import compiled as compiling
from pincette_batch.compiling.linking import Linker


@dataclass(frozen=True, slots=True)
class Decay:
    rate_per_s: float
    limit: float


class Pair(NamedTuple):
    decay: Decay
    value: float


def refuse(value: float) -> float:
    if value < 0.0:
        raise ValueError(f"value = {value}: must not be negative")
    return value


def unchecked(value: float) -> float:
    return value


def decayed(decay: Decay, *, value: float, dt_s: float) -> Decay:
    value = refuse(value)
    return Decay(decay.rate_per_s, value + (value - decay.limit) * expm1(-decay.rate_per_s * dt_s))


def twice(pair: Pair, dt_s: float) -> float:
    once = decayed(pair.decay, value=pair.value, dt_s=dt_s)
    return decayed(once, value=once.limit, dt_s=dt_s).limit


def test_what_is_compiled_has_the_same_bits() -> None:
    pair = Pair(Decay(3.1, 0.7), 1.9)
    fast = compiled(twice, {refuse: unchecked})
    for dt_s in (0.0, 1e-4, 0.3, 7.0):
        assert fast(as_record(pair), dt_s) == twice(pair, dt_s)


def test_a_dataclass_becomes_a_tuple_with_its_fields() -> None:
    record = as_record((Pair(Decay(1.0, 2.0), 3.0), 4.0))
    assert record == (((1.0, 2.0), 3.0), 4.0)
    assert type(record[0].decay) is record_type(Decay)
    assert record[0].decay.limit == 2.0


class Whole(NamedTuple):
    pair: Pair
    weights: tuple[complex, complex]
    number: int
    there: bool


def weighed(whole: Whole) -> float:
    second = whole.weights[1]
    return whole.pair.decay.limit * second.imag + whole.number if whole.there else 0.0


def test_a_record_in_memory_is_read_by_name_and_place() -> None:
    whole = Whole(Pair(Decay(1.0, 2.5), 3.0), (1j, 2.0 + 0.3j), 4, True)
    assert compiled(weighed)(as_structure(whole)) == weighed(whole) == 4.75


def test_what_is_kept_is_known_by_its_code() -> None:
    def digest(function: object) -> str:
        linker = Linker(lambda linked: linked, {refuse: unchecked})
        linker.link(function)  # pyright: ignore[reportArgumentType]
        return linker.digest()

    assert digest(twice) == digest(twice)
    assert digest(twice) != digest(decayed)


def test_what_is_no_function_cannot_be_linked() -> None:
    with pytest.raises(TypeError, match="no function that could be compiled"):
        Linker(lambda linked: linked, {}).link(len)


def test_without_the_extra_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pincette_batch.compiling.compiler.available", lambda: False)
    with pytest.raises(CompilerMissingError, match=r"pincette\[batch\]"):
        compiling(twice)
