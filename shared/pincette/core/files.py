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
"""Number of bytes at the beginning of a text that are searched for zeros, which show an encoding
without a mark.
"""

DRAFT = ".part"
"""Suffix of a file that is still being written."""


@contextmanager
def temporary_folder() -> Generator[Path]:
    """Make a folder for temporary files and remove it at the end.

    Raises OSError with a remedy if the folder cannot be made.
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
    """Error for a text that is not UTF-8; the message names encoding, position and remedy."""


def decoded(content: bytes) -> str:
    """Return decoded UTF-8 without its byte order mark; raises EncodingError."""
    for mark, name in MARKS:
        if content.startswith(mark):
            raise EncodingError(f"it is {name}: {_remedy(name)}")
    head = content[:LOOKED_AT]
    if 3 * head.count(0) > len(head):  # in UTF-16, every second byte of a Latin text is zero
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
    """Replace the content of a file; when the function returns, it is on the disk. Raises OSError.

    See ``replacing``.
    """
    with replacing(path, mode) as draft:
        draft.write_bytes(content)


@contextmanager
def replacing(path: Path, mode: int = 0o666) -> Generator[Path]:
    """Yield a draft in the same folder; it replaces the file when the block ends without an error.

    A reader sees either the old or the new content, even after a power cut. After an error the file
    is unchanged. The draft exists when the block begins, with ``mode`` minus the bits that the
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
    """Make a folder and its parents, and sync the entry of each to the disk; raises OSError."""
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
    """Sync the entries of a folder (names of files, not their content); raises OSError."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno != errno.EINVAL:  # the file system cannot sync folders
            raise
    finally:
        os.close(number)
