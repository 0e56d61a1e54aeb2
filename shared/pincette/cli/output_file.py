"""Files that a person names for the output of a command."""

from pathlib import Path

from pincette.cli import CliError
from pincette.core.files import replace_file


def write_output(path: Path, content: bytes) -> None:
    """Write a file that is on the disk when this returns; raises CliError where it cannot be.

    A link, a device or a pipe, such as ``/dev/stdout``, is written to as it is.
    """
    try:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            path.write_bytes(content)
        else:
            replace_file(path, content)
    except OSError as error:
        raise CliError(f"{path} cannot be written ({error.strerror}): name another") from error
