"""What is known of a running job, from its events. No bpy in here."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...solver.job.events import Event

_STAGE_TEXTS = {
    "photos": "Reading photos", "compile": "Preparing the solver (first run: a minute)",
    "geometry": "Finding the shape", "fit": "Fitting", "asset": "Making mesh and textures",
    "report": "Writing the report",
}  # fmt: skip


@dataclass
class JobModel:
    """State of a job for the panel."""

    state: str = "preparing"
    stage: str = ""
    text: str = "Starting…"
    overall: float = 0.0
    seconds_left: float | None = None
    psnr: float | None = None
    preview_version: int = 0
    warnings: list[str] = field(default_factory=list)
    error: str = ""

    def apply(self, event: Event) -> bool:
        """Take in an event; True if the panel should be drawn anew."""
        data = event.data
        match event.kind:
            case "stage":
                self.state, self.stage = "running", str(data.get("name"))
                self.text, self.seconds_left = _STAGE_TEXTS.get(self.stage, self.stage), None
            case "progress":
                self.overall = float(data.get("overall", self.overall))
                self.seconds_left = data.get("seconds_left")
            case "metric":
                self.psnr = data.get("value")
            case "preview":
                self.preview_version += 1
            case "warning":
                self.warnings.append(str(data.get("text")))
            case "error":
                self.error = str(data.get("message"))
            case "result":
                self.state, self.overall = "finishing", 1.0
            case _:
                return False
        return True

    def ended(self, exit_code: int, log_tail: str) -> None:
        """The process is gone."""
        self.seconds_left = None
        if exit_code == 0:
            self.state, self.text, self.overall = "done", "Done", 1.0
        elif exit_code == 3:
            self.state, self.text = "cancelled", "Cancelled; Resume goes on from here"
        else:
            self.state, self.text = "failed", "Failed"
            self.error = self.error or log_tail or f"The solver ended with code {exit_code}"

    @property
    def time_left(self) -> str:
        """Time left as text."""
        if self.seconds_left is None:
            return ""
        minutes, seconds = divmod(int(self.seconds_left), 60)
        return f"{minutes}:{seconds:02d} left"
