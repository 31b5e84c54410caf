"""What is known of a job, from its events or its folder. No bpy in here."""

import math
from dataclasses import dataclass, field
from typing import Any

from ...solver.job.events import Event, clock
from ...solver.job.exit_codes import BAD_INPUT, CANCELLED, DONE, OUT_OF_MEMORY
from ...solver.job.folder import JobFolder
from ...solver.job.status import process_is_alive, read_status

OUT_OF_MEMORY_ON_WINDOWS = (0xC0000017, 0xC000012D)
"""exit codes: no memory, and no room left in memory and page file together"""
STAGE_TEXTS = {
    "photos": "Reading photos", "compile": "Preparing the solver (first run: a minute)",
    "geometry": "Finding the shape", "fit": "Fitting shape, materials and light",
    "video": "Extracting photos from the video",
    "features": "Finding features", "matching": "Comparing photos",
    "mapping": "Placing cameras", "adjustment": "Refining cameras",
    "check": "Looking at photos", "pictures": "Copying photos that Blender cannot show",
    "asset": "Making mesh and textures", "report": "Writing the report",
}  # fmt: skip


@dataclass
class JobModel:
    """State of a job for the panel.

    Attributes:
        state: new, preparing, running, finishing, done, cancelled, failed or lost.
        overall: share of the whole job that is done, 0 to 1.
        psnr: agreement of the fit with the photos so far, decibels.
        preview_version: counts the previews that were written.
        cancelling: the person pressed Cancel.
    """

    state: str = "preparing"
    stage: str = ""
    text: str = "Starting the solver"
    overall: float = 0.0
    seconds_left: float | None = None
    psnr: float | None = None
    preview_version: int = 0
    resumable: bool = False
    cancelling: bool = False
    warnings: list[str] = field(default_factory=list)
    error: str = ""

    def apply(self, event: Event) -> bool:
        """Take in an event; True if the panel should be drawn anew."""
        data = event.data
        match event.kind:
            case "stage":
                self.state, self.stage = "running", str(data.get("name"))
                self.text, self.seconds_left = STAGE_TEXTS.get(self.stage, self.stage), None
            case "progress":
                overall = _number(data, "overall")
                if overall is not None:
                    self.overall = min(max(overall, 0.0), 1.0)
                self.seconds_left = _number(data, "seconds_left")
            case "metric" if data.get("name") == "psnr":
                self.psnr = _number(data, "value")
            case "preview":
                self.preview_version += 1
            case "warning":
                self.warnings.append(str(data.get("text", "")))
            case "checkpoint":
                self.resumable = True
            case "error":
                self.error = str(data.get("message", ""))
            case "result":
                self.state, self.overall = "finishing", 1.0
            case _:
                return False
        return True

    def ended(self, exit_code: int, said_bye: bool, log_tail: str) -> None:
        """The process is gone.

        Args:
            said_bye: it ended by itself, with its last event; else it crashed or was killed.
        """
        self.seconds_left = None
        if exit_code == DONE:
            self.state, self.text, self.overall = "done", "Done", 1.0
        elif exit_code == CANCELLED or (self.cancelling and not said_bye):
            self.state, self.text, self.error = "cancelled", "Cancelled", ""
        elif exit_code == OUT_OF_MEMORY:
            self.state, self.text = "failed", "Out of memory"
            self.error = (
                self.error or "Close other programs, use smaller photos, or choose the draft preset."
            )
        elif said_bye or self.error or exit_code == BAD_INPUT:
            self.state, self.text = "failed", "The solver stopped"
            self.error = self.error or log_tail or f"It ended with code {exit_code}."
        else:
            self.state, self.text = "failed", "The solver crashed"
            self.error = crash_text(exit_code) + ("\n" + log_tail if log_tail else "")

    @property
    def time_left(self) -> str:
        """Time left as text; empty if it is not known."""
        return "" if self.seconds_left is None else f"{clock(self.seconds_left)} left"


def model_of_folder(job: JobFolder) -> JobModel:
    """What a job's folder says about it, for a job that this Blender did not start."""
    status = read_status(job.status_path)
    model = JobModel(resumable=job.has_checkpoint())
    if job.is_complete():
        model.state, model.text, model.overall = "done", "Done", 1.0
    elif process_is_alive(status):
        model.state, model.text = "elsewhere", "Another process is working on this job"
    elif status.get("state") == "cancelled":
        model.state, model.text = "cancelled", "Cancelled"
    elif status.get("state") == "failed":
        model.state, model.text = "failed", "The solver stopped"
    elif status:
        model.state, model.text = "lost", "The last job was interrupted"
    else:
        model.state, model.text = "new", ""
    return model


def crash_text(exit_code: int) -> str:
    """What the exit code of a process that did not say goodbye tells."""
    if exit_code == -9:
        return "The system ended it, most likely because memory ran out; choose the draft preset."
    if exit_code < 0:
        return f"It was ended by signal {-exit_code}."
    if exit_code in OUT_OF_MEMORY_ON_WINDOWS:
        return "The system had no memory left for it; choose the draft preset."
    if exit_code > 255:  # Windows' own codes are known by their hexadecimal digits
        return f"It ended with code 0x{exit_code:08X}."
    return f"It ended with code {exit_code}."


def _number(data: dict[str, Any], name: str) -> float | None:
    value = data.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if math.isfinite(value) else None
