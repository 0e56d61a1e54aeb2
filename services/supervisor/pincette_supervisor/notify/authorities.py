"""The certificate authorities that receivers of notices are checked against."""

import os
import re
import ssl
from pathlib import Path

from pincette_supervisor.notify.errors import RefusedError

FILE, FOLDER = "SSL_CERT_FILE", "SSL_CERT_DIR"
"""Variables of the environment that name a file, and folders, of authorities to trust."""
HASHED = re.compile(r"[0-9a-f]{8}\.\d+")
"""Names under which OpenSSL looks for certificates in a folder."""
UNKNOWN_ISSUER = (18, 19, 20, 21)
"""Codes by which OpenSSL says that no trusted authority has signed a certificate."""
REMEDY = (
    f"if its certificate comes from a private authority, set {FILE} in the supervisor's environment"
)


def trusted() -> ssl.SSLContext:
    """Return settings that trust the named authorities, or without any those of the system.

    Raises RefusedError if those that are named cannot be read.
    """
    context = ssl.create_default_context()
    file, folders = os.environ.get(FILE), os.environ.get(FOLDER)
    if file:
        try:
            context.load_verify_locations(cafile=file)
        except OSError as error:
            raise RefusedError(
                f"{FILE}={file} has no certificate that can be read ({error.strerror or error}): "
                "name a file in PEM format"
            ) from error
    for folder in (folders or "").split(os.pathsep):
        if folder:
            _check(Path(folder))
    if not file and not folders:
        import certifi

        context.load_verify_locations(cafile=certifi.where())
    return context


def _check(folder: Path) -> None:
    try:
        hashed = any(HASHED.fullmatch(place.name) for place in folder.iterdir())
    except OSError as error:
        raise RefusedError(f"{FOLDER}={folder} cannot be read: {error.strerror}") from error
    if not hashed:
        raise RefusedError(
            f"{FOLDER}={folder} has no certificate under a name that OpenSSL looks for: "
            f"openssl rehash {folder}"
        )
