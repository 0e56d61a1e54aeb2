"""How often each client may ask: token buckets (the leaky bucket as a meter, ITU-T I.371)."""

from collections import OrderedDict
from dataclasses import dataclass

PER_S, BURST = 200.0, 400.0
"""Requests that are refilled each second, and that may come at once: more than a page and an
orchestrator need, less than what keeps the supervisor from everybody else."""
CLIENTS = 1000
"""Buckets that are kept; the one that was used least lately goes."""


@dataclass(slots=True)
class _Bucket:
    tokens: float
    at_s: float


class Buckets:
    """A bucket for each client; the time is the caller's."""

    def __init__(self, per_s: float = PER_S, burst: float = BURST) -> None:
        self._per_s, self._burst = per_s, burst
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()

    def wait_s(self, client: str, now_s: float) -> float:
        """Take one token; 0, or after how long there will be one."""
        bucket = self._buckets.get(client)
        if bucket is None:
            bucket = self._buckets[client] = _Bucket(self._burst, now_s)
            if len(self._buckets) > CLIENTS:
                self._buckets.popitem(last=False)
        else:
            self._buckets.move_to_end(client)
        bucket.tokens = min(self._burst, bucket.tokens + (now_s - bucket.at_s) * self._per_s)
        bucket.at_s = now_s
        if bucket.tokens < 1.0:
            return (1.0 - bucket.tokens) / self._per_s
        bucket.tokens -= 1.0
        return 0.0
