"""Certificates made on the fly, for `--secure`."""

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from pincette.cli.rest import CliError
from pincette.config import RigFile
from pincette.security.establishing import enrol, establish
from pincette.security.folder import Folder
from pincette.security.identity import SecurityError, program

PLACE = "pki"


@contextmanager
def passing(rig: RigFile) -> Generator[Path]:
    """A folder of certificates that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="pincette-") as name:
        yield standing(rig, Path(name))


def standing(rig: RigFile, data: Path) -> Path:
    """The folder of certificates beside the records; it is made, and a rig added, where missing."""
    folder, hosts, now = Folder(data / PLACE), (rig.bus.host,), datetime.now(UTC)
    name, composed = rig.rig.name, rig.rig.composed
    try:
        if not folder.path.exists():
            establish(folder, [name], hosts, now, composed=composed)
        else:
            known = {facts.identity.name for facts in folder.all()}
            missing = [one for one in composed if program(one, name).name not in known]
            if missing or name not in folder.rigs():
                enrol(folder, name, hosts, now, composed=missing)
    except SecurityError as error:
        raise CliError(str(error)) from error
    return folder.path
