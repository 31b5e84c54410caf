"""Start the solver from its own folder, in an isolated Python (`python -I solver/bootstrap.py …`).

`-I` keeps the caller's environment and folders out, so the solver's parent folder is added here.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from solver.start import start  # noqa: E402

if __name__ == "__main__":  # a process that the solver starts for itself reads this file once more
    sys.exit(start())
