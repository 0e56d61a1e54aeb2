"""``python -m pincette`` is the command ``pincette``."""

import sys

from pincette.cli.main import main

sys.exit(main())
