"""The OpenAPI document as a file: ``python -m pincette_supervisor.rest.openapi FILE``."""

import json
import sys
from pathlib import Path
from typing import cast

from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.rest.api import create_app

REGENERATE = "make docs"


def document() -> str:
    """The document as text; the routes are looked at, none is called, so no rig is needed."""
    tree = create_app(cast(Rigs, None)).openapi()
    return json.dumps(tree, indent=2, ensure_ascii=False) + "\n"


def main() -> None:
    """Write the document to the file that is named."""
    Path(sys.argv[1]).write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    main()
