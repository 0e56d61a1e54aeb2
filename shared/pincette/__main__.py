"""``python -m pincette`` is the command ``pincette``."""

import sys

from pincette.cli.door import main

sys.exit(main())
