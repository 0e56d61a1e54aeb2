"""Which version of the wire a program has, and whom to update where it is another.

Programs of different versions use different keys and hear nothing of each other; what each sees of
the other is its liveliness token. The encoding that travels beside a payload is looked at only
where the payload was refused.
"""

from collections.abc import Iterable

from pincette.core.codec.refusals import CodecError, FieldsError
from pincette.core.topics import NAMESPACE, WIRE

MEDIA_TYPE = "application/msgpack"
_MARK = f"{MEDIA_TYPE};{NAMESPACE}.v"
ENCODING = f"{_MARK}{WIRE}"
"""Zenoh's encoding of every payload: the media type, then whose schema it has."""


def of_other_wires(tokens: Iterable[str]) -> dict[str, int]:
    """Programs whose liveliness tokens are of another version of the wire, each with its own."""
    found = {token.rpartition("/")[2]: _wire_of(token) for token in tokens}
    return {program: wire for program, wire in found.items() if wire not in (None, WIRE)}


def update_which(program: str, wire: int) -> str:
    """What to tell a person of a program that has another version of the wire."""
    older = "this program" if wire > WIRE else f"the {program}"
    return f"{program} is there with wire version {wire}, this program has {WIRE}: update {older}"


def explained(error: CodecError, encoding: str, sender: str) -> str:
    """Tell a person why a payload of ``sender`` was refused, by its ``encoding`` too."""
    version = encoding.removeprefix(_MARK)
    if version == encoding:
        said = repr(encoding[:60])
        return f"{error}; its encoding is {said}, not {ENCODING}: {sender} did not send this"
    if version != str(WIRE):
        return f"{error}; {update_which(sender, int(version))}" if _is_wire(version) else str(error)
    if isinstance(error, FieldsError):
        return (
            f"{error}; {sender} says that it has wire version {WIRE}, as this program has: "
            "start all programs with the same version of pincette"
        )
    return str(error)


def _wire_of(token: str) -> int | None:
    """Version of a liveliness token; None where it is none of this project's."""
    parts = token.split("/")
    if len(parts) != 5 or (parts[0], parts[3]) != (NAMESPACE, "live"):
        return None
    version = parts[1].removeprefix("v")
    return int(version) if _is_wire(version) else None


def _is_wire(version: str) -> bool:
    return version.isascii() and version.isdecimal() and len(version) < 10
