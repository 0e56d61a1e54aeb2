"""Reasons for which a notice has not been accepted."""


class RefusedError(Exception):
    """A receiver has not accepted a notice; the text states why. It is sent again later."""


class NotWantedError(Exception):
    """A receiver wants no more notices."""
