#!/usr/bin/env bash
# A client of openapi-python-client returns binary answers as damaged text where an operation also answers with text.
#
# One would expect: an operation answers with `text/csv` or, by its parameter, with `application/octet-stream`. The client
# looks at the answer's Content-Type, or the generator says that it takes one of both alone.
# What happens: the generator takes the first one that the document lists, without a warning, and the client decodes every
# answer as UTF-8 with replacement characters. With the other one first, text comes as a file.
# Seen with openapi-python-client 0.29.1 (PyPI), Python 3.11.7. Make two operations of it, or read `response.content`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet openapi-python-client==0.29.1
cd "$folder"
cat > openapi.json <<'JSON'
{
  "openapi": "3.1.0",
  "info": {"title": "t", "version": "1"},
  "paths": {
    "/table": {
      "get": {
        "operationId": "get_table",
        "responses": {
          "200": {
            "description": "a table",
            "content": {
              "text/csv": {"schema": {"type": "string"}},
              "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
            }
          }
        }
      }
    }
  }
}
JSON
venv/bin/openapi-python-client generate --path openapi.json --meta none --output-path generated > said 2>&1
cat said
venv/bin/python - <<'PYTHON'
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

from generated.api.default import get_table
from generated.client import Client

CONTENT = bytes(range(256))


class Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "application/octet-stream")
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT)

    def log_message(self, *_words):
        pass


server = HTTPServer(("127.0.0.1", 0), Handler)
threading.Thread(target=server.serve_forever, daemon=True).start()
answer = get_table.sync_detailed(client=Client(base_url=f"http://127.0.0.1:{server.server_port}"))
print(answer.headers["content-type"], type(answer.parsed).__name__, repr(answer.parsed)[-40:])
assert "octet-stream" not in Path("said").read_text(), "it is said now: the finding is out of date"
assert isinstance(answer.parsed, str), "it is not text now: the finding is out of date"
assert answer.parsed.encode() != CONTENT and "\ufffd" in answer.parsed, answer.parsed
print("as described: bytes became text, and 128 of them are lost")
PYTHON
