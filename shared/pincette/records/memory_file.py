"""A file in memory that is taken away in parts while it is written."""


class MemoryFile:
    """Keeps what was written since the last ``take``; no disk is needed."""

    closed = False

    def __init__(self, skipped_bytes: int = 0) -> None:
        """``skipped_bytes``: bytes at the begin of the file that ``take`` leaves out."""
        self._parts: list[bytes] = []
        self._skipped_bytes = skipped_bytes
        self._bytes = 0

    def write(self, part: bytes) -> int:
        """Append a part."""
        self._parts.append(bytes(part))
        self._bytes += len(part)
        return len(part)

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self._bytes

    def flush(self) -> None:
        """Do nothing: no part waits elsewhere."""

    def take(self) -> bytes:
        """Return what was written since the last call."""
        found = b"".join(self._parts)
        self._parts.clear()
        skipped = min(self._skipped_bytes, len(found))
        self._skipped_bytes -= skipped
        return found[skipped:]
