"""Make a capture of a camera that moves before a film."""

import bpy
from bpy.types import Context, Event, Operator

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import jobs_folder, new_job_root
from ..nmf_addon.jobs.side_task import SideTask, side_task
from ..nmf_addon.scene.shot import Shot, shot_camera, shot_of
from ..nmf_addon.scene.shot_capture import capture_shot, photos_in, pictures_of
from ..nmf_addon.wrapping import fields
from ..solver.cameras.folder import FEWEST_PHOTOS, MOST_VIDEO_PHOTOS, VIDEO_PHOTOS
from ..solver.capture.errors import CaptureError
from .polls import is_busy, reporting


class NMF_OT_use_moving_camera(Operator):
    """Make a capture from a camera that is tracked, animated or imported, and the footage behind it: one
    camera for each photo, where it stands in the scene"""

    bl_idname = "nmf.use_moving_camera"
    bl_label = "Use Moving Camera"
    bl_options = {"UNDO"}

    first: bpy.props.IntProperty(
        name="First Frame", description="First frame of the scene to use", options={"SKIP_SAVE"}
    )
    last: bpy.props.IntProperty(
        name="Last Frame", description="Last frame of the scene to use", options={"SKIP_SAVE"}
    )
    count: bpy.props.IntProperty(
        name="Photos", default=VIDEO_PHOTOS, min=FEWEST_PHOTOS, max=MOST_VIDEO_PHOTOS,
        description="How many to take at most; from a video, each is the sharpest frame of its part",
    )  # fmt: skip

    @classmethod
    def poll(cls, context: Context) -> bool:
        if is_busy(cls):
            return False
        cls.poll_message_set(
            "Select a camera with a movie clip, a video or an image sequence as background"
        )
        return shot_camera(context) is not None

    def invoke(self, context: Context, event: Event) -> set[str]:
        frames = shot_of(shot_camera(context), context.scene).frames
        if frames:
            self.first, self.last = frames[0], frames[-1]
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: Context) -> None:
        fields(self.layout, self, "first", "last", "count")

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        item = shot_camera(context)
        shot, name, number = shot_of(item, context.scene), item.name, item.session_uid
        scene_number = context.scene.session_uid
        frames = self._frames(shot)
        root = new_job_root(f"{name} cameras", jobs_folder())
        cameras, photos = root / "transforms_train.json", root / "photos"

        def done(task: SideTask) -> None:
            # Found anew: an undo meanwhile has replaced all that Blender had, and its name may be another.
            scenes = sorted(bpy.data.scenes, key=lambda scene: scene.session_uid != scene_number)
            there = ((s, i) for s in scenes for i in s.objects if i.session_uid == number)
            scene, found = next(there, (None, None))
            film = None if found is None else shot_of(found, scene)
            if film is None:
                raise CaptureError(name, "", "the camera or its footage is gone", "start again")
            pictures = photos_in(film, photos)
            # The person may be looking at another scene by now.
            looked_at = bpy.context.scene == scene
            layer = bpy.context.view_layer if looked_at else scene.view_layers[0]
            with bpy.context.temp_override(scene=scene, view_layer=layer):
                made = capture_shot(bpy.context, found, film, pictures, cameras)
            scene.nmf.capture, made_number = made, made.session_uid
            if looked_at:
                task.holds_for = lambda c: c.session_uid == made_number
            task.model.text = f"{len(pictures)} photos extracted"
            bpy.ops.ed.undo_push(message=NMF_OT_use_moving_camera.bl_label)

        if len(frames) < FEWEST_PHOTOS:
            raise CaptureError(
                shot.file, "frames", f"too few: {len(frames)} between the first and the last one",
                "choose others",
            )  # fmt: skip
        if not shot.is_video:
            pictures = pictures_of(shot, frames, self.count)
            context.scene.nmf.capture = capture_shot(context, item, shot, pictures, cameras)
            return {"FINISHED"}
        numbers = frames[0] + shot.offset, frames[-1] + shot.offset
        words = ["frames", str(shot.file), "--out", str(photos), "--photos", str(self.count)]
        words += ["--span", *map(str, numbers), "--events"]
        side_task.start(
            self.bl_label, preferences.solver_python(), words, jobs_folder() / "logs", done,
            f"Its photos are in {photos}",
        )  # fmt: skip

    def _frames(self, shot: Shot) -> list[int]:
        asked = self.properties.is_property_set
        return [
            frame
            for frame in shot.frames
            if (not asked("first") or frame >= self.first) and (not asked("last") or frame <= self.last)
        ]


classes = (NMF_OT_use_moving_camera,)
