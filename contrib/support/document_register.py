"""Register of code blocks on the pages about contrib packages; contrib/tests/test_documents.py
executes these blocks.
"""

from tests.support.document_register import DEMO
from tests.support.documents import Sitting, Typed

OF_BLUESKY = "import bluesky.plan_stubs as bps\nimport bluesky."
SITTINGS: dict[str, Sitting] = {
    "docs/how-to/sila.md": Sitting(
        (
            Typed("pincette run sila", r"ready: SiLA 2 at 127.0.0.1:50052", stays=True),
            Typed("from sila2.client import SilaClient", r"held with 1[45]\.\d\d mN[^$]*released"),
        ),
        up=DEMO,
    ),
    "docs/how-to/foxglove.md": Sitting(
        (
            Typed("pincette run foxglove", r"ready: Foxglove at ws://127", stays=True),
            Typed("pincette job grip", r"succeeded: gripped"),
            Typed("import json", r"estimate pincette\.Estimate[^$]*services: estop"),
        ),
        up=DEMO,
    ),
    "docs/how-to/bluesky.md": Sitting(
        (
            Typed(f"{OF_BLUESKY}preprocessors", r"held with 1[45]\.\d\d mN\s+part: none"),
            Typed(f"{OF_BLUESKY}preprocessors", r"\d+ samples"),
        ),
        up=DEMO,
    ),
    "docs/how-to/agents.md": Sitting(
        (Typed("import asyncio", r"'grip'[^$]*held with 1[45]\.\d\d mN\s+part: none"),),
        up=DEMO,
    ),
    "docs/how-to/batches.md": Sitting(
        (Typed("from concurrent.futures", r"4000\.0 4 \(", seconds=300.0),),
        slow=True,
    ),
}
