"""A capture in every format that there is a reader of."""

import json

import numpy as np

from tests.capture import (
    blocks,
    colmap_models,
    test_bop,
    test_bundler,
    test_camera_dictionary,
    test_co3d,
    test_dtu,
    test_kapture,
    test_lit_objects,
    test_meshroom,
    test_metashape,
    test_middlebury,
    test_mvsnet,
    test_neilf,
    test_nerfactor,
    test_nerfies,
    test_nero,
    test_opendronemap,
    test_openmvg,
    test_opensfm,
    test_opf,
    test_pix4d,
    test_polycam,
    test_pose_folder,
    test_radiance_fields,
    test_realitycapture,
    test_record3d,
    test_scanner_app,
    test_sdfstudio,
    test_stray_scanner,
    test_visualsfm,
)
from tests.capture.programs import COUNT, HEIGHT, WIDTH, names, poses, save_photos

POINTS = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"


def make_transforms(folder):
    save_photos(folder)
    save_photos(folder, [f"{name}_seen" for name in names()])
    (folder / "points.ply").write_text(f"{POINTS}end_header\n0 0 0\n")
    frames = [
        {"file_path": f"{name}.png", "mask_path": f"{name}_seen.png", "transform_matrix": pose.tolist()}
        for name, pose in zip(names(), poses() @ np.diag([1.0, -1, -1, 1]), strict=True)
    ]
    content = {"fl_x": 80, "w": WIDTH, "h": HEIGHT, "ply_file_path": "points.ply", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))


def make_blocks(folder):
    photos = [
        blocks.photo(i, pose, inside=f"<MaskPath>{name}_seen.png</MaskPath>")
        for i, (name, pose) in enumerate(zip(names(), poses(), strict=True))
    ]
    blocks.write(folder, blocks.document([blocks.group(photos)]))
    save_photos(folder / "photos", [f"{name}_seen" for name in names()])


def make_nerfies(folder):
    ids = test_nerfies.IDS
    test_nerfies.make(folder)
    (folder / "dataset.json").write_text(
        json.dumps({"ids": ids, "train_ids": ids, "val_ids": [], "count": COUNT})
    )


MAKERS = {
    "transforms.json": lambda folder, solved: make_transforms(folder),
    "COLMAP": lambda folder, solved: colmap_models.write(
        solved(folder, names=[f"{name}.png" for name in names()]), folder, "txt"
    ),
    "Bundler": lambda folder, solved: test_bundler.export(
        solved(folder, "SIMPLE_PINHOLE", (70, 32, 24)), folder / "bundle.out", "list.txt"
    ),
    "VisualSFM": lambda folder, solved: test_visualsfm.export(
        solved(folder, "SIMPLE_PINHOLE", (70, 32, 24)), folder / "model.nvm"
    ),
    "Meshroom": lambda folder, solved: test_meshroom.write(folder, test_meshroom.scene(folder=".")),
    "OpenMVG": lambda folder, solved: test_openmvg.write(folder, test_openmvg.scene(root=".")),
    "OpenSfM": lambda folder, solved: test_opensfm.write(folder, test_opensfm.scene()),
    "OpenDroneMap": lambda folder, solved: test_opendronemap.write(folder, test_opendronemap.shots()),
    "Metashape": lambda folder, solved: test_metashape.write(folder, test_metashape.simple()),
    "RealityCapture": lambda folder, solved: test_realitycapture.write_table(
        folder, test_realitycapture.table()
    ),
    "BlocksExchange": lambda folder, solved: make_blocks(folder),
    "Kapture": lambda folder, solved: test_kapture.make(folder),
    "OPF": lambda folder, solved: test_opf.write(folder),
    "SDFStudio": lambda folder, solved: test_sdfstudio.write(folder, test_sdfstudio.scene()),
    "splat": lambda folder, solved: test_radiance_fields.make_splat(folder),
    "Nerfies": lambda folder, solved: make_nerfies(folder),
    "Middlebury": lambda folder, solved: test_middlebury.write(folder, test_middlebury.lines()),
    "NeILF": lambda folder, solved: test_neilf.write(folder, test_neilf.scene()),
    "COLMAP, binary": lambda folder, solved: colmap_models.write(solved(folder), folder),
    "XMP sidecars": lambda folder, solved: test_realitycapture.write_sidecars(folder),
    "Polycam": lambda folder, solved: test_polycam.make_polycam(folder),
    "Record3D": lambda folder, solved: test_record3d.make_record3d(folder),
    "3D Scanner App": lambda folder, solved: test_scanner_app.make_scan(folder / "scan"),
    "Stray Scanner": lambda folder, solved: test_stray_scanner.make(folder),
    "NeuS": lambda folder, solved: test_radiance_fields.make_neus(folder),
    "LLFF": lambda folder, solved: test_radiance_fields.make_llff(folder),
    "MVSNet": lambda folder, solved: test_mvsnet.make(folder),
    "DTU": lambda folder, solved: test_dtu.make(folder),
    "NSVF": lambda folder, solved: test_pose_folder.make_nsvf(folder),
    "ScanNet": lambda folder, solved: test_pose_folder.make_scannet(folder),
    "FoundationPose": lambda folder, solved: test_pose_folder.make_reference_views(folder),
    "NeRFactor": lambda folder, solved: test_nerfactor.write(folder),
    "Objects with Lighting": lambda folder, solved: test_lit_objects.make(folder),
    "PhySG cam_dict_norm.json": lambda folder, solved: test_camera_dictionary.make(folder),
    "BOP": lambda folder, solved: test_bop.make(folder, of_world=False),
    "CO3D": lambda folder, solved: test_co3d.make(folder),
    "NeRO": lambda folder, solved: test_nero.make(folder),
    "Pix4D": lambda folder, solved: test_pix4d.write(folder),
}
"""functions of a folder, and of `conftest.solved`, that write a capture there"""
