"""What every table of the rig file is made of."""

from typing import Annotated
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


def _reachable(url: str) -> str:
    """A url that a link can open: a device, or a socket with host and port."""
    if not url.startswith("socket://"):
        return url
    try:
        parts = urlsplit(url)
        if parts.hostname and parts.port:
            return url
    except ValueError:
        pass
    raise ValueError("wanted socket://HOST:PORT with a port from 1 to 65535, or a device")


def _place(text: str) -> str:
    """Where a program listens, as HOST:PORT."""
    try:
        parts = urlsplit(f"//{text}")
        if parts.hostname and parts.port and parts.netloc == text:
            return text
    except ValueError:
        pass
    raise ValueError("wanted HOST:PORT with a port from 1 to 65535")


Url = Annotated[str, AfterValidator(_reachable)]
Place = Annotated[str, AfterValidator(_place)]


class ConfigError(ValueError):
    """A rig file that cannot be used; the text names file, place, value and what is wanted."""


class Table(BaseModel):
    """A table of the rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)
