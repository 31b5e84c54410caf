"""forwarders.py [--move] LIBRARY TARGET [OWN…]: a .def that sends all that a library exports on to TARGET.dll.

What is named as OWN is exported as `own_…` instead. --move copies Wine's own library to TARGET.dll beside it, as
a library of the person's: Wine would look for one of its own by its name.
"""

import re
import subprocess
import sys
from pathlib import Path

MARK = b"Wine builtin DLL"

words = [word for word in sys.argv[1:] if word != "--move"]
library, target, own = Path(words[0]), words[1], words[2:]
if "--move" in sys.argv:
    content = library.read_bytes().replace(MARK, bytes(len(MARK)), 1)
    library.with_name(f"{target}.dll").write_bytes(content)
answer = subprocess.run(
    ["x86_64-w64-mingw32-objdump", "-p", library], capture_output=True, text=True, check=True
)
table = answer.stdout.partition("[Ordinal/Name Pointer] Table")[2]
print("EXPORTS")
for name in re.findall(r"^\s*\[.*\s(\w+)\s*$", table, re.MULTILINE):
    print(f"{name}=own_{name}" if name in own else f"{name}={target}.{name}")
