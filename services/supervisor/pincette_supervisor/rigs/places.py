"""Places of parts that vision clients publish, and their differences from where the arm found the
parts.

Nothing in this module affects the loop: a place only sets what a plan expects of its part.
"""

import json
import logging
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from statistics import fmean, stdev
from threading import Lock
from typing import cast

from pydantic import ValidationError

from pincette.api.places import (
    MeasuredPlace,
    PartPlace,
    PlaceBias,
    PlaceFound,
    PlaceList,
    PlannedPlace,
    SeenPlace,
)
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Message, Place
from pincette.core.topics import PLACE, Topic, key
from pincette.core.validation_wording import refusal, value_text
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.problems import ProblemError

log = logging.getLogger(__name__)
SOURCES_MAX = 16
"""Largest number of sources whose places are kept; a new source replaces the one that has been
silent longest.
"""
JOBS_MAX = 100
"""Number of newest jobs of a source over which its bias is averaged."""
FUTURE_S = 1.0
"""Time by which the clock of a vision client may be ahead, in s."""
Differences = tuple[float, float | None]
"""Differences "found minus given" of the place and of the width of one job's part, in µm.

The second one is None if no width was given.
"""


class Places:
    """Places of the parts of one rig: the newest of each source, and their differences over
    jobs."""

    def __init__(
        self, rig: str, store: Store, write_queue: WriteQueue, refused: RefusedMessages
    ) -> None:
        self.key = key(rig, PLACE)
        self._rig, self._store, self._write_queue = rig, store, write_queue
        self._refused, self._note = refused, f"places:{rig}"
        self._lock = Lock()
        self._newest: dict[str, MeasuredPlace] = {}
        self._differences: dict[str, dict[str, Differences]] | None = None
        """Differences by source and job; None before they were read from the journal."""

    def take(self, _topic: Topic, message: Message) -> None:
        """Store a place from the bus if it belongs to this rig and to the present time."""
        try:
            place = self._checked(cast(Place, message))
        except ValidationError as error:
            found = error.errors()[0]
            named = "".join(f"{name} = {value_text(found['input']):.40}: " for name in found["loc"])
            self._refused.note(self.key, named + refusal(found))
        except ValueError as error:
            self._refused.note(self.key, str(error))
        else:
            with self._lock:
                known = self._newest.get(place.source)
                if known is not None and known.measured_at > place.measured_at:
                    return  # messages may arrive out of order
                self._newest.pop(place.source, None)
                self._newest[place.source] = place
                while len(self._newest) > SOURCES_MAX:
                    del self._newest[next(iter(self._newest))]

    def _checked(self, message: Place) -> MeasuredPlace:
        if message.rig != self._rig:
            raise ValueError(f"rig = {message.rig!r:.40}: this is the key of {self._rig!r}")
        fields = MeasuredPlace.model_fields
        place = MeasuredPlace(**{name: getattr(message, name) for name in fields})
        age_s = place.seconds_until(datetime.now(UTC))
        if age_s < -FUTURE_S:
            raise ValueError(
                f"measured_at lies {-age_s:.3g} s in the future: set the clocks of both computers"
            )
        return place

    def given(self, place: PartPlace) -> PlannedPlace:
        """Return the place that a request states or reads from the bus; raises ProblemError."""
        measured = place.measured() if place.given_by == "request" else self._seen(place.source)
        age_s = measured.seconds_until(datetime.now(UTC))
        found = PlannedPlace(**measured.model_dump(), age_s=age_s, max_age_s=place.max_age_s)
        require_fresh(found, age_s)
        return found

    def _seen(self, source: str) -> MeasuredPlace:
        with self._lock:
            known = dict(self._newest)
        if not source and len(known) == 1:
            return next(iter(known.values()))
        if source in known:
            return known[source]
        named = f"of source {source!r} " if source else ""
        there = f"; there are places of {', '.join(sorted(known))}" if known else ""
        if known and not source:
            named = "without the name of its source can be chosen: several publish "
        raise ProblemError(
            409,
            "place-unknown",
            "The place of the part is not known",
            f"no place {named}has been received on {self.key}{there}{self._why()}",
            sources=sorted(known),
        )

    def _why(self) -> str:
        return f"; the last message was refused: {self.refused}" if self.refused else ""

    @property
    def refused(self) -> str:
        """Return why the last message of a vision client was refused; empty if none was."""
        place, why = self._refused.last
        return why if place == self.key else ""

    def view(self) -> PlaceList:
        """Return the newest place and the bias of each source; raises StoreError."""
        now = datetime.now(UTC)
        with self._lock:
            newest = list(self._newest.values())
            biases = [_bias(source, list(jobs.values())) for source, jobs in self._read().items()]
        return PlaceList(
            rig=self._rig,
            key=self.key,
            newest=[SeenPlace(**one.model_dump(), age_s=one.seconds_until(now)) for one in newest],
            biases=biases,
            refused=self.refused,
        )

    def with_bias(self, job: str, found: PlaceFound) -> PlaceFound:
        """Return the place that a job found, with the bias of its source including this job."""
        if found.difference_um is None:
            return found
        with self._lock:
            try:
                differences = self._read()
            except StoreError as error:
                log.error("%s", error)
                return found
            jobs = differences.pop(found.source, {})
            jobs[job] = found.difference_um, found.width_difference_um
            while len(jobs) > JOBS_MAX:
                del jobs[next(iter(jobs))]
            differences[found.source] = jobs
            while len(differences) > SOURCES_MAX:
                del differences[next(iter(differences))]
            text = json.dumps(differences)
        self._write_queue.submit(partial(self._store.set_note, self._note, text))
        return found.model_copy(update={"bias": _bias(found.source, list(jobs.values()))})

    def _read(self) -> dict[str, dict[str, Differences]]:
        """Return the differences of earlier jobs; raises StoreError."""
        if self._differences is None:
            self._differences = json.loads(self._store.get_note(self._note) or "{}")
        return cast("dict[str, dict[str, Differences]]", self._differences)


def require_fresh(place: PlannedPlace, age_s: float) -> None:
    """Raise ProblemError if a place is older than its request permits, or is in the future."""
    limit_s = -FUTURE_S if age_s < 0.0 else place.max_age_s
    if -FUTURE_S <= age_s <= place.max_age_s:
        return
    words = f"{age_s:.3g} s old, the limit is max_age_s = {limit_s:g} s"
    if age_s < 0.0:
        words = f"measured {-age_s:.3g} s in the future, by more than {FUTURE_S:g} s"
    raise ProblemError(
        409,
        "place-too-old",
        "The place of the part was not measured just now",
        f"the place of {place.source!r} is {words}",
        value=age_s,
        limit=limit_s,
        unit="s",
    )


def _bias(source: str, jobs: Sequence[Differences]) -> PlaceBias:
    places_um = [place_um for place_um, _ in jobs]
    widths_um = [width_um for _, width_um in jobs if width_um is not None]
    return PlaceBias(
        source=source,
        count=len(places_um),
        mean_um=fmean(places_um),
        deviation_um=stdev(places_um) if len(places_um) > 1 else None,
        width_count=len(widths_um),
        width_mean_um=fmean(widths_um) if widths_um else None,
        width_deviation_um=stdev(widths_um) if len(widths_um) > 1 else None,
    )
