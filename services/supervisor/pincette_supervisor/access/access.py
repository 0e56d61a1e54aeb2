"""What the REST interface is given to know who may do what."""

from dataclasses import dataclass, field

from pincette_supervisor.access.buckets import Buckets
from pincette_supervisor.access.gate import Gate
from pincette_supervisor.access.trail import AuditTrail


@dataclass(frozen=True)
class Access:
    """Who comes in, by which names, and how often; as it stands whoever reaches it may come in."""

    gate: Gate = field(default_factory=Gate)
    trail: AuditTrail = field(default_factory=AuditTrail)
    names: frozenset[str] = frozenset()
    """Names of the supervisor beside ``localhost`` and every address."""
    buckets: Buckets | None = None
    """How often each client may ask; None: as often as it likes."""
