"""UTC times of a record: its beginning, its sample 0 and its end."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

from pincette.core.messages import Message, Sample

BEGIN, SAMPLE_0, END = "begin_at", "sample_0_at", "end_at"
UNCERTAINTY = "sample_0_uncertainty_s"
NAMES = (BEGIN, SAMPLE_0, UNCERTAINTY, END)
"""Names under which the metadata of a record's files state the times."""
COMPARED = 4
"""Number of samples after the first one whose arrivals show whether the first one was late."""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LAST_NS = 2**63 - 1


def utc_text(time_ns: int) -> str:
    """Return a time in ns since 1970 as ISO 8601 in UTC, to a microsecond."""
    time = EPOCH + timedelta(microseconds=time_ns // 1000)
    return time.isoformat(timespec="microseconds").replace("+00:00", "Z")


def sample_0_ns(message: Message, arrival_ns: int, period_ns: int) -> int | None:
    """Return when sample 0 arrived, in ns of UTC, estimated from the arrival of this message.

    Returns None for a message that has no sample number.
    """
    if not isinstance(message, Sample) or message.seq < 0:
        return None
    return min(max(0, arrival_ns - message.seq * period_ns), LAST_NS)


class RecordTimes:
    """Times of one record, from the arrivals of its messages.

    All arrivals are measured by one clock that is never set: the time of day at the beginning of
    the record, continued by the monotonic clock.
    """

    def __init__(self, about: Mapping[str, str], period_s: float) -> None:
        """Begin with ``about``, the metadata of the record, which states its beginning."""
        self._begin_at, self._period_ns = about.get(BEGIN), round(period_s * 1e9)
        self._sample_0_ns: int | None = None
        self._earliest_ns = 0
        """Arrival of sample 0 in ns, estimated from the most punctual of the first samples."""
        self._compared_to: int | None = None
        """Number of the last sample that is compared; None once it has arrived."""
        self._end_ns: int | None = None

    def add(self, message: Message, arrival_ns: int) -> None:
        """Add a message of the record, in order of arrival."""
        if self._sample_0_ns is None or self._compared_to is not None:
            self._compare(message, arrival_ns)
        if self._end_ns is None or arrival_ns > self._end_ns:
            self._end_ns = arrival_ns

    def _compare(self, message: Message, arrival_ns: int) -> None:
        found_ns = sample_0_ns(message, arrival_ns, self._period_ns)
        if found_ns is None or not isinstance(message, Sample):
            return
        if self._sample_0_ns is None:
            self._sample_0_ns = self._earliest_ns = found_ns
            self._compared_to = message.seq + COMPARED
        elif self._compared_to is not None and message.seq <= self._compared_to:
            self._earliest_ns = min(self._earliest_ns, found_ns)
        else:
            self._compared_to = None

    def texts(self) -> dict[str, str]:
        """Return the known times by their names.

        A record without samples has no time of sample 0.

        ``end_at`` is the arrival of the last message so far. A sample is taken within one control
        period before its arrival, or earlier if the next samples show that it arrived late.
        """
        found = {} if self._begin_at is None else {BEGIN: self._begin_at}
        if self._sample_0_ns is not None:
            found[SAMPLE_0] = utc_text(self._sample_0_ns)
            late_ns = self._sample_0_ns - self._earliest_ns
            found[UNCERTAINTY] = f"{1e-9 * (self._period_ns + late_ns):.6g}"
        if self._end_ns is not None:
            found[END] = utc_text(self._end_ns)
        return found
