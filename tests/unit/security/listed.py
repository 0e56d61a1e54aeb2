"""Messages that an access list admits."""

from pincette.security.access import Access
from pincette.security.identity import Identity


def lets(access: Access, who: Identity, flow: str, message: str, wanted: str) -> bool:
    """True if a list admits a message: the key of a rule must include that of the message."""
    return any(
        message in rule.messages and rule.flow == flow and includes(granted, wanted)
        for rule in access.get(who.name, ())
        for granted in rule.keys
    )


def includes(granted: str, wanted: str) -> bool:
    """Return whether a key expression with whole-chunk wildcards includes another one."""
    ours, theirs = granted.split("/"), wanted.split("/")
    if ours[-1] == "**":
        return theirs[: len(ours) - 1] == ours[:-1]
    return (
        len(ours) == len(theirs)
        and "**" not in theirs
        and all(one in ("*", other) for one, other in zip(ours, theirs, strict=True))
    )
