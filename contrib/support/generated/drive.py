"""Program that uses a client generated from the OpenAPI document: grip, follow and stop; print
JSON.

Run it in a folder with the generated package ``generated``: ``drive.py URL FORCE_MN SAMPLE``. It
also fetches the table of the jobs with a sample.
"""

import hashlib
import json
import sys
from importlib import import_module
from pathlib import Path
from time import monotonic, sleep
from types import SimpleNamespace
from typing import Any

sys.path.insert(0, str(Path.cwd()))
GENERATED = Path("generated")
API = "/api/v1"
WAIT_S = 60.0
LAST = "manifest.json"
"""File that is written after all others."""
url, force_mN, sample = sys.argv[1], float(sys.argv[2]), sys.argv[3]
models: Any = import_module("generated.models")
client: Any = import_module("generated.client").Client(base_url=url, timeout=WAIT_S)


def call(method: str, path: str, *names: str, **given: Any) -> Any:
    """Call the generated function of a method and path, whatever its name; return the parsed
    response.
    """
    wanted = f'"method": "{method}"', f'"url": "{API}{path}"'
    found = [
        file
        for file in GENERATED.glob("api/*/*.py")
        if all(words in file.read_text(encoding="utf-8") for words in wanted)
    ]
    (file,) = found
    operation = import_module(".".join(file.with_suffix("").parts))
    return operation.sync(*names, client=client, **given)


def job_in(phase: str) -> None:
    """Wait for an event that names a phase of the job."""
    deadline = monotonic() + WAIT_S
    while monotonic() < deadline:
        page = call("get", "/jobs/{job}/events/list", job.id)
        if phase in {event.to_dict()["body"].get("phase") for event in page.events}:
            return
        sleep(0.1)
    raise TimeoutError(phase)


request = {"kind": "grip", "force_mN": force_mN, "autostart": True}
job: Any = call("post", "/jobs", body=models.GripJobRequest.from_dict(request))
job_in("approach")
call("post", "/jobs/{job}/actions", job.id, body=models.ActionRequest.from_dict({"type": "stop"}))
# The enumeration is named after the operation, so its name is not written here.
sums: dict[str, str] = {}
ended = job
deadline = monotonic() + WAIT_S
while LAST not in sums and monotonic() < deadline:
    ended = call("get", "/jobs/{job}", job.id, wait=SimpleNamespace(value="recorded"))
    sums = {
        file.name: file.sha256 for file in call("get", "/jobs/{job}/artifacts", job.id).artifacts
    }
same: dict[str, bool] = {}
for name in ("samples.parquet", "grip.png"):
    content = call("get", "/jobs/{job}/artifacts/{name}/content", job.id, name).payload.read()
    same[name] = hashlib.sha256(content).hexdigest() == sums[name]
table = call("get", "/jobs/export.parquet", sample=sample).payload.read()
export = hashlib.sha256(table).hexdigest()
print(json.dumps({"state": str(ended.state), "same": same, "export": export}))
