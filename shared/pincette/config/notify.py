"""Who is told of ends of jobs and of alarms: webhooks and mail, in ``[supervisor]``."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.config.tables import Table

Told = Literal["job.ended", "alarm.raised", "alarm.cleared"]
"""What can be told of."""
Topics = Annotated[tuple[Told, ...], Field(min_length=1, max_length=3, strict=False)]
DEFAULT: tuple[Told, ...] = ("job.ended", "alarm.raised")
Address = Annotated[str, Field(pattern=r"^[^@\s<>,;]{1,64}@[^@\s<>,;]{1,190}$")]


class Webhook(Table):
    """An address that is posted to, signed as Standard Webhooks does."""

    url: Annotated[str, Field(pattern=r"^https?://[^\s]{1,2000}$")]
    """Such as https://laboratory.example/hooks/pincette."""
    secret_file: str
    """File with the secret, whsec_ and base64, readable by its owner alone; relative to the data
    folder."""
    events: Topics = DEFAULT
    """What it is told of: job.ended, alarm.raised, alarm.cleared."""


class Mail(Table):
    """An SMTP server that mails are sent through."""

    host: Annotated[str, Field(min_length=1, max_length=255)]
    """Of the SMTP server."""
    port: int = Field(default=587, ge=1, le=65535)
    """587 for submission with STARTTLS, 465 for TLS from the first byte on."""
    security: Literal["starttls", "tls", "none"] = "starttls"
    """``none`` is for a server on this machine."""
    user: str = ""
    """Name to sign in with; empty: none."""
    password_file: str = ""
    """File with its password, readable by its owner alone; relative to the data folder."""
    sender: Address
    """Whom the mails are from."""
    to: Annotated[tuple[Address, ...], Field(min_length=1, max_length=20, strict=False)]
    """Whom they are for."""
    events: Topics = DEFAULT
    """What they tell of: job.ended, alarm.raised, alarm.cleared."""
