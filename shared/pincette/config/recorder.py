"""How records are kept, and for how long."""

from pydantic import Field

from pincette.config.tables import NotNegative, Positive, Table


class Recorder(Table):
    """When a record is refused, when it is given up, and when old ones go."""

    min_free_MB: NotNegative = 200.0
    """With less room than this on the disk no record is begun, and so no job."""
    silence_s: float = Field(default=10.0, ge=1.0)
    """A record whose loop has been silent this long is closed as incomplete."""
    keep_days: Positive | None = None
    """Older records are deleted; None: never for their age."""
    keep_GB: Positive | None = None
    """Beyond this much the oldest records are deleted; None: never for their size."""
