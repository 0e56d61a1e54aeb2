"""Keys and cookies as they are made and compared.

Each is 32 bytes of the system's generator. Of these 256 bits nobody guesses one, so what is kept is
a plain SHA-256: a slow hash protects words that people choose, and would let a flood of wrong keys
cost more than a flood of requests.
"""

import hashlib
import hmac
import secrets

BYTES = 32
PREFIX = "pincette_"
"""By which a key that was published by mistake is found and known for what it is."""
LONGEST = 200
"""Characters that are looked at at all."""


def new_key() -> str:
    """Make a key; it is shown once and kept nowhere."""
    return PREFIX + secrets.token_urlsafe(BYTES)


def new_cookie() -> str:
    """Make what a signed-in page sends."""
    return secrets.token_urlsafe(BYTES)


def digest_of(secret: str) -> str:
    """What is kept of a key or a cookie: its SHA-256 as hexadecimal digits."""
    return hashlib.sha256(secret.encode(errors="replace")).hexdigest()


def same(digest: str, other: str) -> bool:
    """Compare two digests in a time that does not tell how far they agree."""
    return hmac.compare_digest(digest, other)
