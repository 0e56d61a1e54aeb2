"""A pure function made ready for a compiler, with all that it calls; its code stays as it is.

What changes is what its names stand for: other functions of the project become linked ones,
dataclasses become tuples with names, keyword-only arguments become ordinary ones. There is no
second statement of a formula that could drift away from the first.
"""

from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from inspect import isclass
from types import CodeType, FunctionType
from typing import Any

from pincette.control.record import field_names
from pincette_batch.compiling.records import record_type

Function = Callable[..., Any]


class Linker:
    """Links functions, each once.

    Parameters
    ----------
    finish
        What becomes of a linked function before others call it.
    instead
        Functions that others take the place of; such as a check that raises with words, of numbers
        that were checked before. What is no function of Python's is taken as it is.
    """

    def __init__(
        self, finish: Callable[[Function], Function], instead: Mapping[Function, Function]
    ) -> None:
        self._finish = finish
        self._instead = instead
        self._linked: dict[Function, Function] = {}
        self._digest = sha256()

    def link(self, function: Function) -> Function:
        """The function with everything it calls linked."""
        if function not in self._linked:
            taken = self._instead.get(function, function)
            if isinstance(taken, FunctionType):
                self._linked[function] = self._finish(self._relinked(taken))
            elif function in self._instead:
                self._digest.update(repr(taken).encode())
                self._linked[function] = taken
            else:
                raise TypeError(f"{taken!r} is no function that could be compiled")
        return self._linked[function]

    def digest(self) -> str:
        """Of the code of all functions that were linked."""
        return self._digest.hexdigest()[:16]

    def _relinked(self, function: FunctionType) -> FunctionType:
        code = function.__code__
        self._digest.update(_essence(code).encode())
        known = dict(function.__globals__)
        for name in _names(code):
            value = known.get(name)
            if isclass(value) and field_names(value) is not None:
                record = known[name] = record_type(value)
                # Machine code that is kept finds its records by this path.
                self._digest.update(f"{record.__module__}.{record.__qualname__}".encode())
            elif isinstance(value, FunctionType):
                known[name] = self.link(value)
            elif isinstance(value, float | int | bool | str | tuple):
                self._digest.update(f"{name}={value!r}".encode())
        plain = code.replace(
            co_argcount=code.co_argcount + code.co_kwonlyargcount, co_kwonlyargcount=0
        )
        return FunctionType(plain, known, function.__name__, function.__defaults__)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _essence(code: CodeType) -> str:
    constants = [_essence(each) if isinstance(each, CodeType) else each for each in code.co_consts]
    return f"{code.co_qualname}{code.co_code.hex()}{code.co_names}{code.co_varnames}{constants}"
