"""The committed OpenAPI document, which tests/project/test_openapi.py compares with the routes."""

import json
from functools import cache
from typing import Any

from tests.support.checkout import ROOT


@cache
def openapi() -> dict[str, Any]:
    """Return the document; reading it takes a hundredth of the time of generating it."""
    return json.loads((ROOT / "deploy" / "openapi.json").read_text(encoding="utf-8"))
