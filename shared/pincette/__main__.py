"""``python -m pincette`` is the command ``pincette``."""

import sys

from pincette.cli.entrypoint import main

sys.exit(main())
