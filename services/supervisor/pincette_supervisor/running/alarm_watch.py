"""Watches one rig for what an operator must learn, with a job or without; never inside the loop."""

import logging
import threading
from collections.abc import Callable
from typing import cast

from pincette.messages import Applied, Status
from pincette.topics import APPLIED
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.running.alarm_rules import Standing, standing
from pincette_supervisor.running.growth import Growth
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.site import Site

log = logging.getLogger(__name__)
LOOK_S, ASK_S = 0.25, 2.0
"""Between two looks, and between two questions to the programs of a rig in real time."""
JOIN_S = 2.0
REFUSED, REFUSED_S = 5, 1.0
"""So many commands refused within so long are no accident of an arming."""
MISSED_SHARE, MISSED_S = 0.01, 10.0
"""Share of the ticks that may be missed within a while."""
BOOT = "boot"
FOREIGN = "owner"
"""Word of a refusal that says that the command was another controller's."""


class AlarmWatch:
    """Raises alarms and clears them; each look takes what is known and asks nobody, but rarely."""

    def __init__(self, site: Site, active: Callable[[], LiveJob | None]) -> None:
        self._site, self._active = site, active
        self._standing: dict[str, Standing] = {}
        self._known = False
        """Whether what an earlier supervisor has left standing was looked up."""
        self._tripped = False
        self._asked_s = float("-inf")
        missed = max(1, round(MISSED_SHARE * MISSED_S / site.rig.rig.period_s))
        self._refused = Growth(REFUSED, REFUSED_S)
        self._missed = Growth(missed, MISSED_S)
        self._lost = Growth(1, REFUSED_S)
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Watch from here on, in a thread."""
        name = f"alarms-{self._site.rig.rig.name}"
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Watch no more."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(JOIN_S)

    def _work(self) -> None:
        while not self._closing.wait(LOOK_S):
            try:
                self.look()
            except StoreError as error:
                log.error("%s", error)

    def look(self) -> None:
        """Compare what is with what was, once."""
        site = self._site
        if site.backlog.flush() and site.store.trouble:
            site.store.probe()
        self._look_at_trip()
        self._look_at_conditions()
        self._look_at_refusals()
        if not site.rig.lockstep:  # where programs may take as long as they like
            self._ask()

    def _look_at_trip(self) -> None:
        site = self._site
        trip = site.observer.trips.newest
        if trip is None or trip.cause == BOOT:
            if self._tripped:
                self._tripped = False
                site.alarms.reset()
            return
        self._tripped = True
        live = self._active()
        job = live.id if live is not None and live.epoch == trip.epoch else None
        site.alarms.tripped(trip.cause, site.trip_words(trip.cause), job)

    def _look_at_conditions(self) -> None:
        alarms = self._site.alarms
        found = {one.cause: one for one in standing(self._site)}
        for cause, one in found.items():
            if cause not in self._standing:
                alarms.raised(cause, one.words, severity=one.severity, job=self._job())
        for cause, one in self._left_standing().items():
            if cause not in found:
                alarms.cleared(cause, f"over: {one.words}")
        self._standing = found

    def _left_standing(self) -> dict[str, Standing]:
        """What stood at the last look; at the first, what an earlier supervisor has left."""
        if self._known:
            return self._standing
        try:
            rows = self._site.alarms.standing()
        except StoreError:
            return self._standing
        self._known = True
        left = {row.cause: Standing(row.cause, row.words) for row in rows}
        return {**left, **self._standing}

    def _look_at_refusals(self) -> None:
        applied = cast("Applied | None", self._site.observer.newest(APPLIED))
        if applied is None:
            return
        count = self._refused.follow(applied.refused, self._site.clock())
        if not count:
            return
        self._site.health.refresh(force=True)
        said = self._site.health.statuses.get("actuator")
        detail = said.detail if isinstance(said, Status) else ""
        cause = "controller.second" if FOREIGN in detail else "actuator.refused"
        words = f"actuator refused {count} commands, limit {REFUSED} in {REFUSED_S:g} s; {detail}"
        self._moment(cause, words)

    def _ask(self) -> None:
        """Ask the programs for what they have counted."""
        site = self._site
        now_s = site.clock()
        if now_s - self._asked_s < ASK_S:
            return
        self._asked_s = now_s
        site.health.refresh()
        sensor, recorder = (site.health.statuses.get(name) for name in ("sensor", "recorder"))
        if isinstance(sensor, Status):
            missed = self._missed.follow(sensor.missed, now_s)
            if missed:
                limit = f"{100.0 * MISSED_SHARE:g} % of the ticks in {MISSED_S:g} s"
                self._moment("ticks.missed", f"sensor missed {missed} ticks, limit {limit}")
        if isinstance(recorder, Status) and (lost := self._lost.follow(recorder.missed, now_s)):
            self._moment("recorder.lost", f"recorder lost {lost} messages: {recorder.detail}")

    def _moment(self, cause: str, words: str) -> None:
        self._site.alarms.raised(
            cause, words, severity="warning", clears="acknowledge", job=self._job()
        )

    def _job(self) -> str | None:
        live = self._active()
        return None if live is None else live.id
