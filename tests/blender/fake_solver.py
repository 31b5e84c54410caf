"""Stands in for `solver/bootstrap.py` in tests: speaks its protocol, needs no torch.

    python fake_solver.py run JOB --events        (how it behaves: NMF_FAKE_MODE)
    python fake_solver.py solve PHOTOS --out FOLDER --events | check JOB --json | pictures JOB --out FOLDER --events

normal   every stage, a preview, a complete result
slow     the same, but its fit takes NMF_FAKE_SECONDS (20); resumed, it finishes
fail     bad input: an error event and exit code 2
oom      out of memory: an error event and exit code 4
raise    a traceback in the log and exit code 1
die      a crash in the middle of the fit, exit code 139, last words in the log
killed   ended by the system half way, as without memory, with a checkpoint
hang     never listens, neither to cancel nor to SIGTERM
silent   runs without a word until it is cancelled
garbage  everything a stream can hold, then a result
flood    twenty thousand events, then a result
holds    leaves a grandchild that holds stdout open, then a result
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).resolve().parent)]

import fake_capture  # noqa: E402
import fake_result  # noqa: E402
import killed  # noqa: E402

from solver.job.control import Control  # noqa: E402
from solver.job.events import EventStream  # noqa: E402
from solver.job.folder import JobFolder  # noqa: E402
from solver.job.status import Heartbeat  # noqa: E402
from solver.replacing import write_json_atomic  # noqa: E402
from solver.streams import take_stdout_for_events  # noqa: E402

STAGES = ("photos", "compile", "geometry", "fit", "asset", "report")
STEPS = 4
SLOW = float(os.environ.get("NMF_FAKE_SECONDS", "20"))


class StandIn:
    """A job and those who listen to it."""

    def __init__(self, job: JobFolder, mode: str, pause: float):
        self.job, self.mode, self.pause = job, mode, pause
        self.stream = take_stdout_for_events()
        self.control = Control(job.cancel_path)
        self.out = EventStream(job.events_path, self.stream)
        self.heartbeat = Heartbeat(job.status_path)

    def run(self) -> int:
        """Say hello, do as the mode says, say goodbye; returns the exit code."""
        if self.mode != "hang":
            self.control.start()
        self.out.emit("hello", version="fake")
        self.heartbeat.update("preparing")
        print("a library's banner on stdout", flush=True)
        code = getattr(self, self.mode, self.normal)()
        self.heartbeat.update({0: "done", 3: "cancelled"}.get(code, "failed"))
        self.out.emit("bye", exit_code=code)
        return code

    def normal(self) -> int:
        """All stages to a result."""
        for index, name in enumerate(STAGES):
            self.out.emit("stage", name=name, index=index, count=len(STAGES))
            seconds = SLOW if name == "fit" and self.mode == "slow" and not self.resumed else 0.0
            if not self.stage(name, index, seconds):
                write_json_atomic(self.job.checkpoint_dir / "state.json", {"step": STEPS})
                self.out.emit("checkpoint", step=STEPS)
                return 3
        fake_result.write_result(self.job.root)
        self.out.emit("result", file="result/manifest.json")
        return 0

    def stage(self, name: str, index: int, seconds: float) -> bool:
        """One stage; False if it was cancelled."""
        begun, step = time.monotonic(), 0
        while step < STEPS or time.monotonic() - begun < seconds:
            step += 1
            done = (time.monotonic() - begun) / seconds if seconds else step / STEPS
            self.out.emit(
                "progress", stage=name, text=name, step=step, steps=STEPS, fraction=done,
                overall=(index + done) / len(STAGES), seconds_left=65.0,
            )  # fmt: skip
            if name == "fit":
                self.heartbeat.update("running", step, STEPS, 65.0)
                self.out.emit("metric", name="psnr", value=20.0 + min(step, 9), step=step)
                if step == STEPS:
                    fake_capture.write_preview(self.job.preview_dir / "render.png", 0.7)
                    self.out.emit("preview", file="preview/render.png")
                if self.mode == "die":
                    print("Segmentation fault (not really)", file=sys.stderr, flush=True)
                    os._exit(139)
            time.sleep(self.pause)
            if self.control.should_stop:
                return False
        return True

    slow = die = normal

    @property
    def resumed(self) -> bool:
        """True if there was a checkpoint."""
        return self.job.has_checkpoint()

    def fail(self) -> int:
        """Bad input."""
        self.out.emit("error", code=2, message="photo.png: it is upside down; turn it.")
        return 2

    def oom(self) -> int:
        """Out of memory."""
        self.out.emit("error", code=4, message="Out of memory: choose the draft preset.")
        return 4

    def killed(self) -> int:
        """Ended from outside, half way."""
        write_json_atomic(self.job.checkpoint_dir / "state.json", {"step": 1})
        self.out.emit("checkpoint", step=1)
        self.heartbeat.update("running", 1, STEPS)
        if os.name == "nt":
            os._exit(killed.EXIT_CODE - 2**32)
        os.kill(os.getpid(), signal.SIGKILL)
        return 1

    def hang(self) -> int:
        """Hears nothing."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        self.out.emit("stage", name="fit", index=3, count=6)
        time.sleep(60)
        return 1

    def silent(self) -> int:
        """Says nothing."""
        while not self.control.should_stop:
            time.sleep(0.02)
        return 3

    def garbage(self) -> int:
        """Whatever may come through a pipe."""
        for line in (
            b"\n", b"\xff\xfe\x00\n", b"{\n", b"[]\n", b'{"ev": 3}\n', b"x" * 100_000 + b"\n",
            b'{"v":1,"t":0,"ev":"progress","overall":"much","seconds_left":[]}\n',
            b'{"v":1,"t":0,"ev":"progress","overall":NaN}\n',
            b'{"v":1,"t":0,"ev":"metric","name":"psnr","value":null}\n',
            b'{"v":9,"t":0,"ev":"unheard-of"}\n', b'{"v":1,"t":0,"ev":"stage"}\n',
        ):  # fmt: skip
            self.stream.buffer.write(line)
            self.stream.buffer.flush()
        return self.normal()

    def flood(self) -> int:
        """More than a timer can take at once."""
        for step in range(20_000):
            self.out.emit("progress", stage="fit", step=step, overall=0.5, seconds_left=1.0)
        return self.normal()

    def holds(self) -> int:
        """A worker of a library outlives the solver and holds its stdout."""
        program = "import time; time.sleep(8)"
        subprocess.Popen([sys.executable, "-c", program], stdout=self.stream.fileno())
        return self.normal()


# A word of the language cannot name a method.
setattr(StandIn, "raise", lambda self: 1 // 0)


def solve(photos: Path, out: Path) -> int:
    """Cameras on a ring for the photos of a folder, by the protocol of `solver solve`.

    From a video five photos are taken, or as many as `--video-photos` says if fewer.
    """
    stream = take_stdout_for_events()
    control = Control(out / "cancel")
    control.start()
    out.mkdir(parents=True, exist_ok=True)
    masks, ignored, model = (
        sys.argv[sys.argv.index(option) + 1] if option in sys.argv else None
        for option in ("--masks", "--ignore", "--camera-model")
    )
    asked = {"photos": str(photos), "masks": masks, "ignored": ignored, "camera_model": model}
    write_json_atomic(out / "solve.json", asked)
    events = EventStream(out / "events.jsonl", stream)
    mode, pause = os.environ.get("NMF_FAKE_MODE", "normal"), 0.02
    if photos.is_file():
        fake_capture.write_capture(out, min(5, int(sys.argv[sys.argv.index("--video-photos") + 1])))
        photos = out / "photos"
    names = sorted(path.name for path in photos.iterdir() if path.suffix in (".png", ".HEIC"))
    for index, stage in enumerate(("features", "matching", "mapping", "adjustment")):
        events.emit("stage", name=stage, index=index, count=4)
        events.emit("progress", stage=stage, text=stage, fraction=0.5, overall=(index + 0.5) / 4,
                    seconds_left=3.0)  # fmt: skip
        until = time.monotonic() + (20 if mode == "slow" else pause)
        while time.monotonic() < until:
            time.sleep(0.01)
            if control.should_stop:
                events.emit("bye", exit_code=3)
                return 3
    if mode == "fail":
        events.emit("error", code=2, message=f"{photos}, photos: {names[0]} is plain; photograph it.")
        events.emit("bye", exit_code=2)
        return 2
    fake_capture.write_cameras(out / "transforms_train.json", names)
    events.emit("warning", text="the last photo overlaps no other")
    events.emit("result", file="transforms_train.json", placed=len(names), photos=len(names) + 1)
    events.emit("bye", exit_code=0)
    return 0


def frames(out: Path) -> int:
    """Three pictures of a span of a video, by the protocol of `solver frames`."""
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        events = EventStream(Path(folder) / "events.jsonl", take_stdout_for_events())
        first, last = map(int, sys.argv[sys.argv.index("--span") + 1 :][:2])
        names = [f"frame_{number:06d}.png" for number in (first, (first + last) // 2, last)]
        for name in names:
            fake_capture.write_pixels(out / name, np.full((48, 80, 3), 0.5))
        events.emit("result", photos=names)
        events.emit("bye", exit_code=0)
        events.close()
    return 0


def check(job: Path) -> int:
    """One finding for the first camera of a job, by the protocol of `solver check --events`."""
    import json

    events = EventStream(job / "events.jsonl", take_stdout_for_events())
    request = JobFolder.open(job).request
    frames = json.loads(Path(request.capture).read_text(encoding="utf-8"))["frames"]
    findings = [
        {"level": "warning", "photo": frames[0]["name"], "text": "it is blurred; leave it out"},
        {"level": "note", "photo": None, "text": f"{len(frames)} photos"},
    ]
    print("a library's banner")
    estimate = {"text": f"about 5 minutes and 1.6 GB on {request.device}", "seconds": 300.0}
    box = {"min": [-0.5, -0.25, 0.0], "max": [0.5, 0.25, 1.0]}
    events.emit("stage", name="check", index=0, count=1)
    events.emit("result", report={"findings": findings, "estimate": estimate, "box": box})
    events.emit("bye", exit_code=0)
    return 0


def pictures(job: Path, out: Path) -> int:
    """A grey picture for each photo of a job, by the protocol of `solver pictures`."""
    import json

    import numpy as np

    events = EventStream(job / "events.jsonl", take_stdout_for_events())
    request = JobFolder.open(job).request
    frames = json.loads(Path(request.capture).read_text(encoding="utf-8"))["frames"]
    made = {frame["file_path"]: str(out / f"{frame['name']}.png") for frame in frames}
    for path in made.values():
        fake_capture.write_pixels(Path(path), np.full((48, 80, 3), 0.5))
    events.emit("result", pictures=made)
    events.emit("bye", exit_code=0)
    return 0


def main() -> int:
    """Run; returns the exit code."""
    if sys.argv[1] == "doctor":
        print("Neural Microfacet Fields (stand-in)\nCUDA not available: the CPU is used")
        return 0
    if sys.argv[1] == "solve":
        return solve(Path(sys.argv[2]), Path(sys.argv[sys.argv.index("--out") + 1]))
    if sys.argv[1] == "frames":
        return frames(Path(sys.argv[sys.argv.index("--out") + 1]))
    if sys.argv[1] == "check":
        return check(Path(sys.argv[2]))
    if sys.argv[1] == "pictures":
        return pictures(Path(sys.argv[2]), Path(sys.argv[sys.argv.index("--out") + 1]))
    job = JobFolder.open(sys.argv[2])
    mode = os.environ.get("NMF_FAKE_MODE", "normal")
    return StandIn(job, mode, float(os.environ.get("NMF_FAKE_PAUSE", "0.01"))).run()


if __name__ == "__main__":
    sys.exit(main())
