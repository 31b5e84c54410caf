"""What the panel remembers, per scene."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .callbacks import detach
from .compat import PATH_OPTIONS
from .redraw import is_rendering
from .scene.capture_collection import is_capture


# Blender evaluates the annotations below where lambdas would not find this module's names.
def _may_be_chosen(settings: NMF_scene, collection: bpy.types.Collection) -> bool:
    return collection in settings.id_data.collection.children_recursive and is_capture(collection)


def _choice(name: str, description: str, *items: tuple[str, str, str], default: str | None = None):
    return bpy.props.EnumProperty(
        name=name, description=description, items=items, default=default or items[0][0]
    )


class NMF_scene(bpy.types.PropertyGroup):
    """Choices for the next reconstruction."""

    capture: bpy.props.PointerProperty(
        name="Capture",
        description="Collection of cameras with photos to reconstruct from",
        type=bpy.types.Collection,
        poll=_may_be_chosen,
    )
    preset: _choice(
        "Preset", "How much time to spend on quality",
        ("draft", "Draft", "Minutes on any computer, to see whether the capture works"),
        ("standard", "Standard", "Finer shape, crisper reflections; about three times as long as Draft"),
    )  # fmt: skip
    device: _choice(
        "Device", "What the solver runs on",
        ("auto", "Automatic", "A graphics card if the solver can use it, else the processor"),
        ("cpu", "CPU", "The processor"), ("cuda", "CUDA", "An NVIDIA graphics card"),
        ("mps", "Metal", "An Apple graphics chip"),
    )  # fmt: skip
    exposure: _choice(
        "Exposure", "Whether photos differ in brightness or tint",
        ("fixed", "As Shot", "All photos share one exposure and white balance"),
        ("gain", "Even Out", "Find each photo's exposure, if the camera was on automatic"),
        ("white_balance", "Even Out with Color", "Find each photo's exposure and white balance"),
    )  # fmt: skip
    turntable: _choice(
        "Turntable", "Whether the object was turned instead of the camera moving around it",
        ("auto", "Automatic", "Detect it from the cameras and from what is next to the object"),
        ("yes", "Yes", "The object was turned in front of a still camera: highlights stayed in place"),
        ("no", "No", "The camera went round the object"),
    )  # fmt: skip
    texture_size: _choice(
        "Textures", "Size of the result's textures in pixels",
        *(
            (str(size), f"{size} × {size}", text)
            for size, text in (
                (512, "For distant objects"), (1024, "For most objects"),
                (2048, "For close-ups; about half a minute more"),
                (4096, "For photos with that much detail; about two minutes and 4 GB of memory more"),
            )
        ),
        default="1024",
    )  # fmt: skip
    use_time_limit: bpy.props.BoolProperty(
        name="Time Limit", description="Plan the reconstruction to end within a given time"
    )
    time_limit: bpy.props.FloatProperty(
        name="Minutes",
        description="Minutes for the whole reconstruction, mesh and textures included",
        default=10.0, min=1.0, soft_max=120.0, step=100, precision=0,
    )  # fmt: skip
    seed: bpy.props.IntProperty(name="Seed", description="Number that fixes all random choices", min=0)
    job: bpy.props.StringProperty(
        name="Job", description="Folder of the last job", subtype="DIR_PATH", options=PATH_OPTIONS
    )


def chosen_overrides(settings: NMF_scene) -> dict[str, str]:
    """What the panel says where it is not what presets say, as `JobRequest.overrides`."""
    names = {
        "exposure": "fit.exposure", "turntable": "light.turntable",
        "texture_size": "asset.texture_size",
    }  # fmt: skip
    return {
        key: getattr(settings, name)
        for name, key in names.items()
        if getattr(settings, name) != settings.bl_rna.properties[name].default
    }


classes = (NMF_scene,)


@persistent
def _let_go(scene: bpy.types.Scene, *_) -> None:
    """The tab neither names a capture that was taken out of its scene, nor keeps it in the file."""
    chosen = None if scene.library or is_rendering() else scene.nmf.capture
    if chosen is not None and chosen not in scene.collection.children_recursive:
        scene.nmf.capture = None


def register() -> None:
    bpy.types.Scene.nmf = bpy.props.PointerProperty(type=NMF_scene)
    bpy.app.handlers.depsgraph_update_post.append(_let_go)


def unregister() -> None:
    detach(_let_go, bpy.app.handlers.depsgraph_update_post)
    del bpy.types.Scene.nmf
