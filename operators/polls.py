"""When operators can be used, and what they say where they fail."""

from collections.abc import Callable
from functools import wraps

from bpy.types import Context, Operator

from ..nmf_addon.jobs.side_task import TaskError, side_task
from ..nmf_addon.runtime import RuntimeMissing
from ..nmf_addon.scene.capture_collection import active_capture
from ..nmf_addon.scene.measure import MeasureError
from ..nmf_addon.words import words_of
from ..solver.capture.errors import CaptureError
from ..solver.job.request import JobError

FOR_PEOPLE = (CaptureError, JobError, MeasureError, TaskError, RuntimeMissing, OSError)


def is_busy(operator: type[Operator]) -> bool:
    """Whether a task runs beside which no other may begin; its name is told where an operator is grey."""
    operator.poll_message_set(f"{side_task.title} is running")
    return side_task.running


class WithCapture:
    """For operators that need a capture in the scene."""

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set("Import a capture first")
        return active_capture(context) is not None


def reporting(*others: type[Exception]) -> Callable[[Callable], Callable]:
    """Makes of `execute` one that is finished unless it says otherwise, and reports what is for people.

    Args:
        others: errors that are, too, such as Blender's own.
    """

    def reports(execute: Callable) -> Callable:
        @wraps(execute)
        def run(self: Operator, context: Context) -> set[str]:
            try:
                return execute(self, context) or {"FINISHED"}
            except (*FOR_PEOPLE, *others) as error:
                self.report({"ERROR"}, words_of(error))
                return {"CANCELLED"}

        return run

    return reports
