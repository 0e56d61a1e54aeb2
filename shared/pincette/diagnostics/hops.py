"""Properties of a device server between host and instrument, estimated from the arrival times of
replies.
"""

from collections.abc import Iterator

from pincette.diagnostics import Finding, noted

DEFAULT_HELD_S, NEXT_HELD_S = 0.003, 0.004
"""Default hold time of ser2net 4 at any baud rate (two characters at 9600 baud, rounded up to whole
milliseconds), and the next longer one, in s. A measured time is a little longer than the setting.
"""


def not_asked_for(name: str, count: int) -> Iterator[Finding]:
    """Return the possible senders of replies without a request, if there were any."""
    if count:
        yield noted(
            f"{name}: {count} answers without a request",
            "does the device server admit a second client (ser2net: max-connections, socat: fork "
            "without max-children=1), or does an adapter repeat lines?",
        )


def hop_findings(name: str, held_s: float, line_baud: int) -> Iterator[Finding]:
    """Yield findings about a server that delays replies, and about a line slower than stated.

    Parameters
    ----------
    name
        Instrument and url, or program.
    held_s, line_baud
        As in ``ExchangeTimes``.
    """
    if held_s:
        is_default = DEFAULT_HELD_S <= held_s < NEXT_HELD_S
        cause = (
            "this is ser2net's `chardelay` at its default, 3 ms at any baud rate"
            if is_default
            else "a device server collects the bytes, as ser2net does with `chardelay-scale`, "
            "`chardelay-min` and `chardelay-max`"
        )
        yield noted(
            f"{name}: answers arrive in one piece, {1000.0 * held_s:.1f} ms after their "
            f"transmission: {cause}",
            "in ser2net.yaml, under `options:` of this connection, write `chardelay: "
            "false`; at another server set packing or inter-character time to 0. If they "
            "are 0 already, the instrument itself needs this time, or the line is slower "
            "than options.baud states",
        )
    if line_baud:
        yield noted(
            f"{name}: answers arrive as on a line of about {line_baud} baud, slower than the "
            "rig file states",
            "over TCP, the server does not use the baud rate of the rig file: set "
            "instrument and server to options.baud",
        )
