"""`python -m solver`."""

import sys

from .start import start

sys.exit(start())
