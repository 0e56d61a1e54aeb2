"""Decode text files from other programs; replace files so that a power cut cannot damage them."""

import codecs
import errno
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
"""Number of bytes at the beginning of a text in which zeros show an encoding without a mark."""

DRAFT = ".part"
"""End of the name of a file that is being written."""


@contextmanager
def temporary_folder() -> Generator[Path]:
    """Make a folder for temporary files and remove it at the end.

    Raises OSError with the remedy where none can be made.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="pincette-", ignore_cleanup_errors=True)
    except OSError as error:
        raise OSError(
            error.errno,
            f"no temporary folder can be made ({error}): free space there, or set another "
            "folder in the environment variable TMPDIR",
        ) from error
    with made as name:
        yield Path(name)


class EncodingError(ValueError):
    """A text is not UTF-8; the message names the encoding, the place and the remedy."""


def decoded(content: bytes) -> str:
    """Return decoded UTF-8 without its byte order mark; raises EncodingError."""
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
            f"it is not UTF-8: byte 0x{content[error.start]:02X} in line {line}; save it as "
            f"UTF-8. If it comes from an older Windows program: {_remedy('WINDOWS-1252')}"
        ) from error


def _remedy(encoding: str) -> str:
    return f"save it as UTF-8, or `iconv -f {encoding} -t UTF-8 FILE > NEW`"


def replace_file(path: Path, content: bytes, mode: int = 0o666) -> None:
    """Replace a file by new content, which is on the disk when this returns; raises OSError.

    See ``replacing``.
    """
    with replacing(path, mode) as draft:
        draft.write_bytes(content)


@contextmanager
def replacing(path: Path, mode: int = 0o666) -> Generator[Path]:
    """Yield a draft in the same folder; it replaces the file when the block ends without an error.

    A reader sees the old content or the new content, also after a power cut. After an error the
    file is unchanged. The draft exists when the block begins, with ``mode`` minus the bits that the
    umask of the process forbids. Raises OSError.
    """
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}{DRAFT}")
    os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode))
    try:
        yield draft
        publish(draft, path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise


def publish(draft: Path, path: Path) -> None:
    """Sync a complete draft, move it to its path in the same folder, and sync the folder.

    Raises OSError.
    """
    with draft.open("rb") as stream:
        os.fsync(stream.fileno())
    draft.replace(path)
    sync_folder(path.parent)


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """Make a folder and those above it, and sync the entry of each; raises OSError."""
    if folder.is_dir():
        return
    make_folder(folder.parent, mode)
    folder.mkdir(mode=mode, exist_ok=True)
    try:
        sync_folder(folder.parent)
    except OSError:
        with suppress(OSError):
            folder.rmdir()
        raise


def sync_folder(folder: Path) -> None:
    """Sync the entries of a folder: its files' names, not their content; raises OSError."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno != errno.EINVAL:  # a file system that cannot sync a folder
            raise
    finally:
        os.close(number)
