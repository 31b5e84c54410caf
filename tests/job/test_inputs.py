"""What a job's request names: its capture, and the photos that are held out from it."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.job.folder import JobFolder
from solver.job.inputs import capture_of, held_out_of
from solver.job.request import JobRequest, overrides_of

DUCK = Path(__file__).parents[2] / "samples" / "duck"


def test_another_job_whose_decoder_is_taken_over_is_found_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = overrides_of(["fit.decoder=first", "fit.steps=2"])
    assert found == {"fit.decoder": str(tmp_path / "first"), "fit.steps": "2"}
    assert overrides_of(["fit.decoder="]) == {"fit.decoder": ""}


def job_of(capture, folder):
    return JobFolder.create(folder, JobRequest(capture=str(capture)))


@pytest.mark.parametrize("named", [".", "transforms_train.json"], ids=["its folder", "its file"])
def test_held_out_photos_are_others_than_those_of_the_fit(named, tmp_path):
    job = job_of(DUCK / named, tmp_path / "job")
    held_out = held_out_of(job, capture_of(job))
    assert held_out.source.name == "transforms_test.json"
    paths = [{c.image_path for c in capture.cameras} for capture in (capture_of(job), held_out)]
    assert not paths[0] & paths[1]


def test_a_capture_that_is_fitted_holds_nothing_out(tmp_path):
    job = job_of(DUCK / "transforms_test.json", tmp_path / "job")
    assert held_out_of(job, capture_of(job)) is None and len(capture_of(job).cameras) > 0


def test_without_a_file_of_their_own_no_photos_are_held_out(tmp_path):
    duck = shutil.copytree(DUCK, tmp_path / "duck")
    (duck / "transforms_test.json").unlink()
    job = job_of(duck, tmp_path / "job")
    assert held_out_of(job, capture_of(job)) is None


def test_masks_of_fitted_photos_are_none_of_others_with_the_same_names(tmp_path):
    duck = shutil.copytree(DUCK, tmp_path / "duck")
    masks = tmp_path / "masks"

    def add_masks_of(folder):
        (masks / folder).mkdir(parents=True)
        for photo in json.loads((duck / f"transforms_{folder}.json").read_text())["frames"]:
            file = f"{photo['file_path']}.png"
            Image.open(duck / file).getchannel("A").save(masks / file)

    add_masks_of("train")
    job = JobFolder.create(tmp_path / "job", JobRequest(capture=str(duck), masks=str(masks)))
    with pytest.raises(CaptureError, match=r"r_0\.png.*would be the mask of.*named like their photos'"):
        held_out_of(job, capture_of(job))
    add_masks_of("test")
    found = {camera.mask_path.parent.name for camera in held_out_of(job, capture_of(job)).cameras}
    assert found == {"test"}
