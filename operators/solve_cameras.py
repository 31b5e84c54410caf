"""Find the cameras of photos, or of a video, that have none."""

import os
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.types import Context, Event, Operator

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import jobs_folder, new_job_root
from ..nmf_addon.jobs.side_task import SideTask, side_task
from ..nmf_addon.scene.archives import unpack_all
from ..nmf_addon.wrapping import fields
from ..solver.cameras.folder import (
    FEWEST_PHOTOS,
    MOST_VIDEO_PHOTOS,
    VIDEO_PHOTOS,
    SolveFolder,
    check_of_video,
    is_video,
)
from ..solver.capture.archives import ARCHIVES, is_archive
from ..solver.capture.errors import CaptureError
from ..solver.capture.ignored import check_given
from ..solver.capture.image_header import EXTENSIONS
from ..solver.capture.picture_names import VIDEOS
from .import_capture import IGNORED
from .polls import is_busy, reporting

LENSES = (
    ("OPENCV", "Standard", "Distortion that most lenses have"),
    ("SIMPLE_RADIAL", "Simple Radial", "Less freedom, for few photos or where Standard fails"),
    ("OPENCV_FISHEYE", "Fisheye", "Fisheyes, and action cameras at their widest"),
    ("PINHOLE", "No Distortion", "Renders, and photos that a program has undistorted"),
)


class NMF_OT_solve_cameras(Operator):
    """Find where photos were taken from, and import them with their cameras: pick their folder, an archive
    or a video. Takes minutes for a hundred photos"""

    bl_idname = "nmf.solve_cameras"
    bl_label = "Solve Cameras"

    directory: bpy.props.StringProperty(
        name="Photos", description="Folder of the photos", subtype="DIR_PATH", options={"SKIP_SAVE"}
    )
    filepath: bpy.props.StringProperty(
        name="Video", description="A video or an archive of photos, instead of a folder",
        subtype="FILE_PATH", options={"SKIP_SAVE"},
    )  # fmt: skip
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{extension}" for extension in EXTENSIONS + VIDEOS + ARCHIVES),
        options={"HIDDEN"},
    )
    sequential: bpy.props.BoolProperty(
        name="In Order", description="The photos were taken one after the other, as in a video"
    )
    single_camera: bpy.props.BoolProperty(
        name="One Lens", description="All photos were taken with one lens at one zoom and focus"
    )
    camera_model: bpy.props.EnumProperty(
        name="Lens Model", items=LENSES, description="How lenses may bend what they show"
    )
    video_photos: bpy.props.IntProperty(
        name="Video Photos", default=VIDEO_PHOTOS, min=FEWEST_PHOTOS, max=MOST_VIDEO_PHOTOS,
        description="How many to take from a video: each is the sharpest frame of its part",
    )  # fmt: skip
    # No subtype: the file browser cannot open another one.
    masks: bpy.props.StringProperty(
        name="Masks",
        description="Folder of masks, relative to the photos' folder (masks, ../masks) or a full path: "
        "only what they show is used. For an object turned in front of a still camera, with anything still "
        "behind it",
    )
    ignored: bpy.props.StringProperty(
        name="Ignore", description=f"{IGNORED}. Relative to the photos' folder, or a full path"
    )

    @classmethod
    def poll(cls, context: Context) -> bool:
        return not is_busy(cls)

    def invoke(self, context: Context, event: Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: Context) -> None:
        names = "sequential", "single_camera", "camera_model", "video_photos", "masks", "ignored"
        column = fields(self.layout, self, *names)
        column.label(text="Pick the photos' folder, their archive or a video", icon="INFO")

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        picked = Path(bpy.path.abspath(self.filepath))
        of_video, of_archive = is_video(picked), is_archive(picked)
        # A photo that was picked stands for its folder.
        source = picked if of_video or of_archive else Path(bpy.path.abspath(self.directory))
        if not (of_video or of_archive) and not (self.directory and source.is_dir()):
            missing = source if self.directory else picked
            raise CaptureError(missing, "", "there is no such folder", "choose the photos' folder")
        (source,) = unpack_all(context, [source])
        stated = [_stated(source, text.strip()) for text in (self.masks, self.ignored)]
        masks, ignored = unpack_all(context, stated)
        if of_video:
            check_of_video(source, masks, ignored)
        check_given(None, masks, ignored)
        name = source.stem if of_video else source.name
        out = _unfinished(source) or new_job_root(f"{name} cameras", jobs_folder())
        words = ["solve", str(source), "--out", str(out), "--events"]
        words += ["--camera-model", self.camera_model]
        words += ["--matcher", "sequential"] if self.sequential else []
        words += ["--single-camera"] if self.single_camera else []
        words += ["--video-photos", str(self.video_photos)] if of_video else []
        words += ["--masks", str(masks)] if masks else []
        words += ["--ignore", str(ignored)] if ignored else []
        photos = SolveFolder(out).video_photos_dir if of_video else source

        def done(task: SideTask) -> None:
            # True: an operator called from Python makes no undo step of its own accord.
            bpy.ops.nmf.import_capture(
                "EXEC_DEFAULT", True, filepath=str(out), photos=str(photos), masks=str(masks or ""),
                ignored=str(ignored or ""),
            )  # fmt: skip
            result = next(e.data for e in task.events if e.kind == "result")
            said = f"{result.get('placed')} of {result.get('photos')} photos have a camera"
            task.model.text, warnings = said, task.model.warnings
            number = bpy.context.scene.nmf.capture.session_uid
            task.holds_for = lambda c: c.session_uid == number
            if bpy.ops.nmf.show_photos.poll():
                with suppress(RuntimeError):  # its button stays
                    bpy.ops.nmf.show_photos(said=said)
                    task.model.warnings += warnings

        python = preferences.solver_python()
        # The log lies beside the folder, which has to be new.
        given = (("Photos", photos), ("Masks", masks), ("Ignore", ignored))
        kept = ", ".join(
            [f"Import Capture from {out}", *(f"{name}: {path}" for name, path in given if path)]
        )
        side_task.start("Solve Cameras", python, words, jobs_folder() / "logs", done, kept)
        # The fields keep what was typed for the photos before.
        if masks:
            self.report({"INFO"}, f"Only what the masks in {masks} show is used")
        if ignored:
            self.report({"INFO"}, f"What is white in {ignored} is ignored in the photos")


def _stated(source: Path, text: str) -> Path | None:
    """A path as seen from the photos' folder or a video's, from the blend file (//), or whole; or None."""
    place = source.parent if is_video(source) else source
    return Path(os.path.normpath(place / bpy.path.abspath(text))) if text else None


def _unfinished(photos: Path) -> Path | None:
    """The folder of a solve of these photos, or of this video, that was stopped, so that it goes on."""
    begun = [SolveFolder(path.parent) for path in sorted(jobs_folder().glob("*/solve.json"))]
    asked = str(photos.absolute())
    return next(
        (f.root for f in begun if f.begun().get("photos") == asked and not f.cameras_path.exists()), None
    )


class NMF_OT_cancel_task(Operator):
    """Stop solving or checking"""

    bl_idname = "nmf.cancel_task"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return side_task.running and not side_task.model.cancelling

    def execute(self, context: Context) -> set[str]:
        side_task.cancel()
        return {"FINISHED"}


classes = (NMF_OT_solve_cameras, NMF_OT_cancel_task)
