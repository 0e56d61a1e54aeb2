"""Readiness of a rig, as a signal for the suspenders of a RunEngine."""

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from threading import Event, Thread
from typing import Any

from pincette.client import NotPermittedError, RigHandle

LOOK_S = 0.2
"""Time between two readings, in s."""


class Ready:
    """Signal that is true while the rig accepts commands; false after 1 s without news from it.

    Suspenders call ``subscribe`` and ``clear_sub``, which signals of ophyd have and those of
    ophyd-async do not. A thread reads the rig while there is a subscription.

    Parameters
    ----------
    name
        Called for the name of the signal, which a suspender shows.
    rig
        Called for the rig that is read, over a separate connection.
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
                    # A suspender raises where the engine is busy; the next reading reaches it.
                    with suppress(RuntimeError):
                        function(value=ready)
