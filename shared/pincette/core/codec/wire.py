"""Version of the wire protocol of a program, and what to update if versions differ.

Programs of different versions use different keys and receive no messages from each other; each sees
only the other's liveliness token. The encoding that accompanies a payload is examined only if the
payload was refused.
"""

from collections.abc import Iterable

from pincette.core.codec.refusals import CodecError, FieldsError
from pincette.core.topics import NAMESPACE, WIRE

MEDIA_TYPE = "application/msgpack"
_MARK = f"{MEDIA_TYPE};{NAMESPACE}.v"
ENCODING = f"{_MARK}{WIRE}"
"""Zenoh's encoding of every payload: the media type, then the name of the schema."""


def of_other_wires(tokens: Iterable[str]) -> dict[str, int]:
    """Return the programs whose liveliness tokens contain another version of the wire protocol."""
    found = {token.rpartition("/")[2]: _wire_of(token) for token in tokens}
    return {program: wire for program, wire in found.items() if wire not in (None, WIRE)}


def update_which(program: str, wire: int) -> str:
    """Return what a person should update if a program has another version of the wire protocol."""
    older = "this program" if wire > WIRE else f"the {program}"
    return f"{program} runs with wire version {wire}, this program has {WIRE}: update {older}"


def explained(error: CodecError, encoding: str, sender: str) -> str:
    """Return why a payload of ``sender`` was refused; ``encoding`` may show another wire
    version.
    """
    version = encoding.removeprefix(_MARK)
    if version == encoding:
        shown = repr(encoding[:60])
        return f"{error}; its encoding is {shown}, not {ENCODING}: it was not sent by {sender}"
    if version != str(WIRE):
        return f"{error}; {update_which(sender, int(version))}" if _is_wire(version) else str(error)
    if isinstance(error, FieldsError):
        return (
            f"{error}; {sender} states wire version {WIRE}, as this program does: start all "
            "programs with the same version of pincette"
        )
    return str(error)


def _wire_of(token: str) -> int | None:
    """Return the version in a liveliness token, or None if it is not a token of this project."""
    parts = token.split("/")
    if len(parts) != 5 or (parts[0], parts[3]) != (NAMESPACE, "live"):
        return None
    version = parts[1].removeprefix("v")
    return int(version) if _is_wire(version) else None


def _is_wire(version: str) -> bool:
    return version.isascii() and version.isdecimal() and len(version) < 10
