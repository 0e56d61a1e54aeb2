"""File in memory whose parts are removed while it is being written."""


class MemoryFile:
    """Keeps the bytes written since the last ``take``; no disk is needed."""

    closed = False

    def __init__(self, skipped_bytes: int = 0) -> None:
        """Create an empty file; ``take`` leaves out the first ``skipped_bytes``."""
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
        """Do nothing: no data is buffered elsewhere."""

    def take(self) -> bytes:
        """Return the bytes that were written since the last call."""
        found = b"".join(self._parts)
        self._parts.clear()
        skipped = min(self._skipped_bytes, len(found))
        self._skipped_bytes -= skipped
        return found[skipped:]
