"""Stands in for the solver in tests: speaks its protocol, needs neither torch nor numpy.

NMF_FAKE_MODE: normal, fail, die, hang, garbage, slow.
"""

import json
import os
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from fake_result import write_png, write_result  # noqa: E402

MODE = os.environ.get("NMF_FAKE_MODE", "normal")
cancelled = threading.Event()


def emit(kind, **data):
    print(json.dumps({"v": 1, "t": time.time(), "ev": kind, **data}), flush=True)


def listen():
    for line in sys.stdin:
        if "cancel" in line and MODE != "hang":
            cancelled.set()
    os._exit(3)


def main():
    command, root, flag = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    assert (command, flag) == ("run", "--events")
    threading.Thread(target=listen, daemon=True).start()
    emit("hello", version="fake")
    for name in ("photos", "fit"):
        emit("stage", name=name)
        for step in range(1, 6):
            if MODE == "garbage":
                print("a library says hello", flush=True)
            if MODE == "die" and name == "fit":
                print("Segmentation fault (not really)", file=sys.stderr, flush=True)
                os._exit(139)
            time.sleep(0.3 if MODE in ("slow", "hang") else 0.01)
            emit("progress", stage=name, text=name, fraction=step / 5, overall=step / 10, seconds_left=5 - step)
            if cancelled.is_set():
                emit("bye", exit_code=3)
                return 3
            while MODE == "hang" and step == 2:
                time.sleep(1)
        if name == "fit":
            (root / "preview").mkdir(exist_ok=True)
            write_png(root / "preview" / "render.png", (200, 90, 40), 32)
            emit("preview", file="preview/render.png")
    if MODE == "fail":
        emit("error", code=2, message="photo.png: it is upside down; turn it.")
        emit("bye", exit_code=2)
        return 2
    write_result(root)
    emit("result", file="result/manifest.json")
    emit("bye", exit_code=0)
    return 0


sys.exit(main())
