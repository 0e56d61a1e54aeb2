#!/usr/bin/env bash
# FastAPI declares its document as OpenAPI 3.1.0 and describes streams by a field that only OpenAPI 3.2 has.
#
# One would expect: a document that says 3.1.0 has the fields of 3.1, so that the schema of that version accepts it.
# What happens: a path operation that yields server-sent events has `itemSchema` in its media type. OpenAPI 3.2 brought that
# field; the schema of 3.1 and linters such as @redocly/cli refuse the document, and generators see no schema of the stream.
# Seen with fastapi 0.165.0 (PyPI), Python 3.11.7. Set `app.openapi_version`, or rename the field to `x-itemSchema`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fastapi==0.165.0 openapi-spec-validator==0.9.0
"$folder/venv/bin/python" - <<'PYTHON'
from collections.abc import AsyncIterator

from fastapi import FastAPI
from fastapi.sse import EventSourceResponse
from openapi_spec_validator import OpenAPIV31SpecValidator
from pydantic import BaseModel


class Sample(BaseModel):
    x: float


app = FastAPI()


@app.get("/live", response_class=EventSourceResponse)
async def live() -> AsyncIterator[Sample]:
    yield Sample(x=1.0)


document = app.openapi()
content = document["paths"]["/live"]["get"]["responses"]["200"]["content"]["text/event-stream"]
faults = [one.message for one in OpenAPIV31SpecValidator(document).iter_errors()]
print("declared:", document["openapi"], "; fields of the stream:", list(content))
print("faults by the schema of 3.1:", faults)
assert document["openapi"].startswith("3.1"), "another version now: the finding is out of date"
assert "itemSchema" in content and faults, "it is valid 3.1 now: the finding is out of date"
print("as described: a document of 3.1 with a field of 3.2")
PYTHON
