"""Notifications about ended jobs and about alarms, by webhook and mail, in ``[supervisor]``."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.config.tables import Table

Told = Literal["job.proposed", "job.ended", "job.recorded", "alarm.raised", "alarm.cleared"]
"""Events about which notifications can be sent."""
Topics = Annotated[tuple[Told, ...], Field(min_length=1, max_length=5, strict=False)]
DEFAULT: tuple[Told, ...] = ("job.ended", "alarm.raised")
Address = Annotated[str, Field(pattern=r"^[^@\s<>,;]{1,64}@[^@\s<>,;]{1,190}$")]


class Webhook(Table):
    """Address that receives POST requests signed as in Standard Webhooks."""

    url: Annotated[str, Field(pattern=r"^https?://[^\s]+$", max_length=2000)]
    """Address, such as https://laboratory.example/hooks/pincette."""
    secret_file: str
    """File with the secret, whsec_ and base64, readable by its owner alone; relative to the data
    folder."""
    events: Topics = DEFAULT
    """Events that are sent to the webhook: job.proposed, job.ended, job.recorded, alarm.raised,
    alarm.cleared."""


class Mail(Table):
    """SMTP server for mails."""

    host: Annotated[str, Field(min_length=1, max_length=255)]
    """Host of the SMTP server."""
    port: int = Field(default=587, ge=1, le=65535)
    """Port of the server: 587 for submission with STARTTLS, 465 for TLS from the first byte on."""
    security: Literal["starttls", "tls", "none"] = "starttls"
    """Security of the connection; ``none`` is for a server on this machine."""
    user: str = ""
    """User name for the SMTP login; empty: no login."""
    password_file: str = ""
    """File with the password, readable by its owner alone; relative to the data folder."""
    sender: Address
    """Sender of the mails."""
    to: Annotated[tuple[Address, ...], Field(min_length=1, max_length=20, strict=False)]
    """Recipients of the mails."""
    events: Topics = DEFAULT
    """Events that cause a mail: job.proposed, job.ended, job.recorded, alarm.raised,
    alarm.cleared."""
