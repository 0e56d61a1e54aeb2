"""Readiness of a rig, as a signal for the suspenders of a RunEngine."""

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from threading import Event, Thread
from typing import Any

from pincette.client import NotPermittedError, RigHandle

LOOK_S = 0.2
"""Time between two readings, in s."""


class Ready:
    """Signal that is true while the rig accepts commands; false if no reading has arrived for 1 s.

    Suspenders call ``subscribe`` and ``clear_sub``, methods of ophyd signals that ophyd-async
    signals lack. A thread reads the rig while there is a subscription.

    Parameters
    ----------
    name
        Function that returns the name of the signal, which a suspender shows.
    rig
        Function that returns the rig to read, over a separate connection.
    """

    def __init__(
        self,
        name: Callable[[], str],
        rig: Callable[[], AbstractContextManager[RigHandle]],
    ) -> None:
        self._name, self._rig = name, rig
        self._functions: list[Callable[..., Any]] = []
        self._ended = Event()

    @property
    def name(self) -> str:
        """Name of the signal."""
        return self._name()

    def __repr__(self) -> str:
        return f"Ready({self.name!r})"

    def subscribe(
        self,
        function: Callable[..., Any],
        event_type: str | None = None,  # noqa: ARG002 - a signal has one type of event
        run: bool = True,
    ) -> None:
        """Call a function with each reading as ``value``; with ``run`` also at once."""
        if run:
            with self._rig() as rig:
                function(value=rig.status().ready)
        self._functions.append(function)
        if len(self._functions) == 1:
            self._ended = Event()
            Thread(target=self._watch, args=(self._ended,), daemon=True).start()

    def clear_sub(self, function: Callable[..., Any]) -> None:
        """End the subscription of a function."""
        self._functions.remove(function)
        if not self._functions:
            self._ended.set()

    def close(self) -> None:
        """End all subscriptions."""
        self._functions.clear()
        self._ended.set()

    def _watch(self, ended: Event) -> None:
        with self._rig() as rig:
            while not ended.wait(LOOK_S):
                ready = False
                with suppress(NotPermittedError):
                    ready = rig.status().ready
                for function in tuple(self._functions):
                    # A suspender raises an error while the engine is busy, and then acts on the
                    # next reading.
                    with suppress(RuntimeError):
                        function(value=ready)
