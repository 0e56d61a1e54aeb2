"""Contents of responses other than JSON, as the OpenAPI document describes them."""

from typing import Any

Content = dict[str, dict[str, Any]]
"""Schema of a body by its media type."""
_BYTES = {"schema": {"type": "string", "format": "binary"}}
CSV: Content = {"text/csv; charset=utf-8": {"schema": {"type": "string"}}}
BINARY: Content = {"application/octet-stream": _BYTES}
"""Content of Parquet files; generated clients have bytes for this media type."""
PNG: Content = {"image/png": _BYTES}
