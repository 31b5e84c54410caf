"""libraries.py WHEEL FOLDER: take Python's libraries for Windows out of Panda3D's wheel."""

import sys
import zipfile
from pathlib import Path

BESIDE = ("python311.dll", "vcruntime140.dll", "vcruntime140_1.dll")
"""what the program itself needs"""

wheel, folder = Path(sys.argv[1]), Path(sys.argv[2])
with zipfile.ZipFile(wheel) as archive:
    for name in archive.namelist():
        file = name.removeprefix("deploy_libs/")
        if file == name or file.startswith("api-ms-"):  # those are Wine's
            continue
        place = folder if file.lower() in BESIDE else folder / "DLLs"
        (place / file).write_bytes(archive.read(name))
