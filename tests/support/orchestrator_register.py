"""The part of the register for pages about orchestrators, agents and viewers."""

from tests.support.documents import Sitting, Told, Typed

DEMO = "deploy/rigs/demo.toml"
IN_ITS_OWN = "tests/orchestrators/test_madsci.py does so, in an environment of its own"
ROS = "tests/orchestrators/test_ros2.py runs the bridge; rmw_zenoh_cpp is in no registry of Python"
EXTRA = "requirements/dev.txt has the extra already"

ORCHESTRATORS: dict[str, Sitting] = {
    "docs/how-to/sila.md": Sitting(
        (
            Typed(".venv/bin/pincette run sila", r"ready: SiLA 2 at 127.0.0.1:50052", stays=True),
            Typed("from sila2.client import SilaClient", r"held with 1[45]\.\d\d mN[^$]*released"),
        ),
        up=DEMO,
    ),
    "docs/how-to/foxglove.md": Sitting(
        (
            Typed(".venv/bin/pincette run foxglove", r"ready: Foxglove at ws://127", stays=True),
            Typed(".venv/bin/pincette job grip", r"outcome +gripped"),
            Typed("import json", r"estimate pincette\.Estimate[^$]*services: estop"),
        ),
        up=DEMO,
    ),
    "docs/how-to/bluesky.md": Sitting(
        (
            Told("pip install 'pincette[bluesky]'", EXTRA),
            Typed("import bluesky.plan_stubs", r"held with 1[45]\.\d\d mN\s+part: none"),
            Typed("import bluesky.plan_stubs", r"\d+ samples"),
        ),
        up=DEMO,
    ),
    "docs/how-to/agents.md": Sitting(
        (
            Told("pip install 'pincette[mcp]'", EXTRA),
            Typed("import asyncio", r"'grip'[^$]*held with 1[45]\.\d\d mN\s+part: none"),
        ),
        up=DEMO,
    ),
    "docs/how-to/madsci.md": Sitting(
        (
            Told("python3 -m venv data/madsci", IN_ITS_OWN),
            Told("NODE_URL=", IN_ITS_OWN),
            Told("data/madsci/bin/python -", IN_ITS_OWN),
        )
    ),
    "docs/how-to/ros2.md": Sitting(
        (
            Told("ZENOH_CONFIG_OVERRIDE=", ROS),
            Told(".venv/bin/python docs/examples/ros2_bridge.py", ROS),
            Told("export RMW_IMPLEMENTATION", ROS),
        )
    ),
    "docs/how-to/web-of-things.md": Sitting(
        (
            Typed("curl -s --fail-with-body http://127.0.0.1:8000/.well-known/wot"),
            Told("npm install", "tests/orchestrators/test_thing_description.py installs it"),
        ),
        up=DEMO,
    ),
    "docs/tutorials/orchestrator.md": Sitting(
        (
            Typed(
                ".venv/bin/python docs/examples/orchestrator.py", "part-3: released", seconds=200.0
            ),
            Typed("from pincette.client import Supervisor", r"True \[\]"),
            Typed("job = rig.start("),
            Typed("for event in job.events()", r"the part is held\nsucceeded"),
            Typed("for file in job.artifacts()", r"samples\.parquet \d+ [0-9a-f]{64}"),
        ),
        up=DEMO,
        slow=True,
    ),
}
