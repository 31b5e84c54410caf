"""Checkpoints: the complete state as safetensors and JSON, which hold no code; written beside, renamed."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from ..brdf.neural import NeuralTerm
from ..capture.turntable import Turntable
from ..field.field import MicrofacetField
from ..field.occupancy import Occupancy
from ..field.room import Room
from ..job.folder import set_aside
from ..job.request import JobError
from ..light.environment import EnvironmentMap
from ..light.floor import Floor
from ..light.irradiance import Arriving
from ..render.probes import Nodes
from ..render.probing import PASSING_STEPS
from ..render.scene import Scene
from ..replacing import replace_file, write_json_atomic
from .adam import beginning_with
from .same_photos import COLOURS, POSES, check_exposed
from .settings import Settings
from .trainer import Trainer

TENSORS, STATE = "scene.safetensors", "state.json"
FORMAT = 2
"""of a checkpoint; raise it with each change of what one holds"""
_COUNTS = ("step", "fraction", "level", "steps_at_level", "fraction_at_level", "probe_turn")
"""of a trainer"""


def save_checkpoint(trainer: Trainer, folder: Path, seconds: float, done: bool) -> None:
    """Write the trainer's state; a reader finds the old or the new checkpoint, never a mixture.

    Args:
        seconds: wall time the job has taken so far, whenever it ran. done: the fit is over.

    Raises:
        JobError, OSError: it cannot be written; the last one stays.
    """
    scene, settings = trainer.scene, trainer.settings
    tensors = {f"scene.{key}": value for key, value in scene.state_dict().items()}
    tensors["generator.pixels"] = trainer.generator.get_state()
    tensors["occupancy"] = scene.occupancy.occupied
    tensors["allowed"] = scene.occupancy.allowed
    tensors["corner_depth"] = scene.occupancy.corner_depth
    tensors |= _probe_tensors(scene)
    if trainer.open_detail.share is not None:
        tensors["light.open_detail"] = trainer.open_detail.share
    tensors["outlines.left_out"] = trainer.outlines.left_out
    tensors |= {COLOURS: trainer.bank.mean_colours, POSES: trainer.bank.poses}
    tensors |= {f"optimiser.{key}": value for key, value in trainer.optimiser.state().items()}
    if trainer.exposures is not None:
        tensors |= {f"exposures.{key}": v for key, v in trainer.exposures.state().items()}
    state = {
        "format": FORMAT, **{name: getattr(trainer, name) for name in _COUNTS},
        "batching": trainer.batching.state(),
        "outlines": trainer.outlines.state(),
        "seconds": seconds, "done": done, "seed": trainer.seed, "use_masks": trainer.use_masks,
        "background": trainer.background,
        "field": {
            "size": scene.field.size, "half_size": scene.field.half_size,
            "axes": None if scene.field.axes is None else scene.field.axes.tolist(),
            "density_components": settings.field.density_components,
            "feature_components": settings.field.feature_components,
            "feature_size": settings.field.feature_size,
            "smoothed_normals": scene.field.smoothed_normals,
            "density_scale": scene.field.density_scale,
            "density_shift": scene.field.density_shift, "steepness": scene.field.steepness,
            "smoothing": scene.field.smoothing,
            "occupancy_cells": scene.occupancy.cells,
        },
        "origin": scene.origin.tolist(),
        "environment_height": scene.environment.height,
        "floor": scene.environment.floor and scene.environment.floor._asdict(),
        "turntable": scene.turntable and {
            name: values.tolist() for name, values in vars(scene.turntable).items()
        },
        "room": scene.room and {
            "size": scene.room.size, "half_size": scene.room.half_size,
            "nearest": scene.room.nearest,
        },
        "settings": dataclasses.asdict(settings),
    }  # fmt: skip
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True, exist_ok=True)
    try:
        save_file({k: v.detach().contiguous().cpu() for k, v in tensors.items()}, part / TENSORS)
    except SafetensorError as error:
        raise JobError(
            f"{folder.parent}: the checkpoint cannot be written ({error}); free space and resume the job."
        ) from error
    write_json_atomic(part / STATE, state)
    shutil.copymode(part / STATE, part / TENSORS)  # safetensors lets nobody else read its files
    old = set_aside(folder)
    if folder.exists():  # else the last one is still set aside
        shutil.rmtree(old, ignore_errors=True)
        replace_file(folder, old)
    replace_file(part, folder)
    shutil.rmtree(old, ignore_errors=True)


def read_state(folder: Path) -> dict | None:
    """The checkpoint's JSON; None if there is no checkpoint. Repairs an interrupted renaming.

    Raises:
        JobError: it is damaged.
    """
    old = set_aside(folder)
    if not (folder / STATE).is_file() and (old / STATE).is_file():
        shutil.rmtree(folder, ignore_errors=True)
        replace_file(old, folder)
    path = folder / STATE
    try:
        state = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
        if state is not None and (not isinstance(state, dict) or state.get("format") != FORMAT):
            raise ValueError("it is not whole, or another version of the solver wrote it")
        return state
    except ValueError as error:
        raise _damaged(path, error) from error


def keep_seconds(folder: Path, seconds: float) -> None:
    """Let a checkpoint, if there is one, know what the job has taken since it was written."""
    state = read_state(folder)
    if state is not None:
        write_json_atomic(folder / STATE, {**state, "seconds": seconds})


def _damaged(path: Path, error: Exception) -> JobError:
    return JobError(
        f"{path}: the checkpoint cannot be read ({error}); delete the folder {path.parent.name} next to "
        "the result to start the fit again."
    )


def _tensors_of(path: Path) -> dict[str, Tensor]:
    try:
        return load_file(path)
    except (SafetensorError, FileNotFoundError) as error:
        raise _damaged(path, error) from error


def read_tensor(folder: Path, name: str) -> Tensor | None:
    """One tensor of a checkpoint; None if it has none of this name.

    Raises:
        JobError: it is damaged.
    """
    path = folder / TENSORS
    try:
        with safe_open(path, "pt") as file:
            # A copy, as in `load_scene`.
            return file.get_tensor(name).clone() if name in file.keys() else None  # noqa: SIM118 (no mapping)
    except (SafetensorError, FileNotFoundError) as error:
        raise _damaged(path, error) from error


def load_scene(folder: Path, device: str = "cpu") -> tuple[Scene, dict, dict[str, Tensor]]:
    """The scene of a checkpoint, its JSON state and all its tensors.

    Raises:
        JobError: there is no checkpoint, or a damaged one.
    """
    state = read_state(folder)
    if state is None:
        raise JobError(f"{folder}: there is no checkpoint; run the reconstruction first.")
    # Copies: loaded tensors are views of the file, which Windows then lets nobody replace. Doubles stay
    # where they are: not every device has them.
    tensors = {
        name: values.clone() if values.dtype == torch.float64 else values.to(device, copy=True)
        for name, values in _tensors_of(folder / TENSORS).items()
    }
    shape = state["field"]
    field = MicrofacetField(
        tensors["scene.field.centre"], shape["half_size"], shape["size"],
        shape["density_components"], shape["feature_components"], shape["feature_size"],
        smoothed_normals=shape["smoothed_normals"],
        density_scale=shape["density_scale"], density_shift=shape["density_shift"],
        axes=shape["axes"] and torch.tensor(shape["axes"]),
    )  # fmt: skip
    field.smoothing, field.steepness = shape["smoothing"], shape["steepness"]
    scene = Scene(
        field, EnvironmentMap(state["environment_height"], floor=_floor_of(state)),
        NeuralTerm(shape["feature_size"]), shape["occupancy_cells"], _room_of(state, tensors),
        state["origin"], _turntable_of(state),
    ).to(device)  # fmt: skip
    scene.load_state_dict(beginning_with("scene.", tensors))
    _restore_occupancy(scene.occupancy, tensors)
    _restore_probes(scene, tensors)
    return scene, state, tensors


def _room_of(state: dict, tensors: dict[str, Tensor]) -> Room | None:
    shape = state["room"]
    if shape is None:
        return None
    return Room(
        tensors["scene.room.centre"], shape["half_size"], shape["size"],
        tensors["scene.room.allowed"], shape["nearest"],
    )  # fmt: skip


def _turntable_of(state: dict) -> Turntable | None:
    values = state["turntable"]
    return values and Turntable(**{name: np.array(value) for name, value in values.items()})


def _floor_of(state: dict) -> Floor | None:
    values = state["floor"]
    return values and Floor(tuple(values["up"]), values["height"], tuple(values["centre"]))


def _restore_occupancy(occupancy: Occupancy, tensors: dict[str, Tensor]) -> None:
    occupancy.allowed = tensors["allowed"]
    occupancy.fill(tensors["occupancy"], tensors["corner_depth"])


def _probe_tensors(scene: Scene) -> dict[str, Tensor]:
    if scene.probes.arriving is None:
        return {}
    (nodes,), (passing, lobes, sent) = scene.probes.nodes, scene.probes.arriving
    return {
        "probes.row": nodes.row.int(), "probes.clear": nodes.clear,
        "probes.spacing": torch.tensor(nodes.spacing, dtype=torch.float64),
        "probes.passing": (passing * PASSING_STEPS).round().byte(), "probes.lobes": lobes,
        "probes.sent": sent,
    }  # fmt: skip


def _restore_probes(scene: Scene, tensors: dict[str, Tensor]) -> None:
    if "probes.row" not in tensors:
        return
    nodes = Nodes(tensors["probes.row"].long(), tensors["probes.clear"], float(tensors["probes.spacing"]))
    passing = tensors["probes.passing"].float() / PASSING_STEPS
    arriving = Arriving(passing, tensors["probes.lobes"], tensors["probes.sent"])
    scene.probes.fill([nodes], arriving)


def restore(trainer: Trainer, state: dict, tensors: dict[str, Tensor]) -> None:
    """Bring a trainer made with the checkpoint's scene to the checkpoint's state.

    Raises:
        JobError: its photos are others than those whose exposures the checkpoint knows.
    """
    for name in _COUNTS:
        setattr(trainer, name, state[name])
    trainer.generator.set_state(tensors["generator.pixels"].cpu())
    trainer.optimiser.restore(beginning_with("optimiser.", tensors))
    if trainer.exposures is not None:
        check_exposed(tensors, trainer.bank.mean_colours)
        trainer.exposures.restore(beginning_with("exposures.", tensors))
    trainer.outlines.restore(state["outlines"], tensors["outlines.left_out"])
    trainer.open_detail.share = tensors.get("light.open_detail")
    trainer.batching.restore(state["batching"])
    # A new trainer refreshes the grid; the interrupted one would have done so only later.
    _restore_occupancy(trainer.scene.occupancy, tensors)


def settings_of(state: dict) -> Settings:
    sections = {}
    for section in dataclasses.fields(Settings):
        values = state["settings"][section.name].items()
        sections[section.name] = section.type(
            **{name: tuple(v) if isinstance(v, list) else v for name, v in values}
        )
    return Settings(**sections)
