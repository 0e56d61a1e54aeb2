"""Files: text that people and other programs wrote, and files that are replaced whole."""

import codecs
import os
import secrets
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

MARKS = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
"""Byte order marks of other encodings; those of UTF-32 begin as those of UTF-16 do."""
LOOKED_AT = 200
"""Bytes at the begin of a text in which zeros show an encoding without a mark."""


@contextmanager
def temporary_folder() -> Generator[Path]:
    """Make a folder for temporary files, and remove it at the end.

    Raises OSError with the remedy where none can be made.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="pincette-", ignore_cleanup_errors=True)
    except OSError as error:
        raise OSError(
            error.errno,
            f"no temporary folder can be made ({error}): make room there, or name another folder "
            "in the environment variable TMPDIR",
        ) from error
    with made as name:
        yield Path(name)


class EncodingError(ValueError):
    """A text is not UTF-8; names the encoding, the place and the remedy."""


def decoded(content: bytes) -> str:
    """Decode UTF-8, leaving out its byte order mark; raises EncodingError."""
    for mark, name in MARKS:
        if content.startswith(mark):
            raise EncodingError(f"it is {name}: {_remedy(name)}")
    head = content[:LOOKED_AT]
    if 3 * head.count(0) > len(head):  # every other character of a Latin text in UTF-16
        raise EncodingError(f"it is UTF-16 or UTF-32 without a mark: {_remedy('UTF-16LE')}")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise EncodingError(
            f"it is not UTF-8: byte 0x{content[error.start]:02X} in line {line}; save it as UTF-8. "
            f"Where it came from an older Windows program: {_remedy('WINDOWS-1252')}"
        ) from error


def _remedy(encoding: str) -> str:
    return f"save it as UTF-8, or `iconv -f {encoding} -t UTF-8 FILE > NEW`"


def replace_file(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Write a file whole: on the disk when this returns, and as it was before on any error.

    A reader sees the old content or the new one, also after a loss of power. ``mode`` is that of
    the file from its first byte on, less what the process does not allow. Raises OSError.
    """
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    number = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk; raises OSError."""
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
