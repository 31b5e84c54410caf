"""How a process ends for which the system has no memory left, and what the panel says of that."""

import os

EXIT_CODE = 0xC000012D if os.name == "nt" else -9
WORDS = "no memory left" if os.name == "nt" else "because memory ran out"
