"""Photos and masks at a reduced size, turned as their cameras saw them."""

import numpy as np
import pytest
from PIL import Image

from solver.capture.reduced import load_reduced, load_reduced_mask, read_header
from tests.capture.pictures import write


@pytest.mark.parametrize("upright", [False, True])
def test_a_mask_may_lie_as_the_photo_does_or_as_it_is_looked_at(upright, tmp_path):
    shown = np.zeros((30, 40), np.uint8)
    shown[:10, 20:] = 255
    turned = np.rot90(shown, -1)  # what EXIF's 6 makes of it
    Image.fromarray(turned if upright else shown).save(tmp_path / "mask.png")
    np.testing.assert_array_equal(load_reduced_mask(tmp_path / "mask.png", (40, 30), 6), turned)


def test_photos_are_reduced_upright_with_their_alpha(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    pixels = np.zeros((300, 400, 3), np.uint8)
    pixels[:, :100] = 255  # the left of the file is the top of the picture
    Image.fromarray(pixels).save(tmp_path / "a.jpg", exif=exif)
    colour, alpha = load_reduced(tmp_path / "a.jpg", 100)
    assert colour.shape == (100, 75, 3) and alpha is None
    assert colour[:20].min() > 200 and colour[30:].max() < 50
    header = read_header(tmp_path / "a.jpg")
    assert (header.width, header.height, header.focal) == (300, 400, None)
    Image.fromarray(np.full((8, 8), 40000, np.uint16)).save(tmp_path / "b.png")
    colour, _ = load_reduced(tmp_path / "b.png", 100)
    assert colour.shape == (8, 8, 3) and abs(int(colour[0, 0, 0]) - 40000 / 257) < 2


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_tiffs_are_reduced_by_means_as_other_photos_are(dtype, tmp_path):
    fine = np.indices((240, 320)).sum(axis=0) % 2 * np.iinfo(dtype).max
    write(tmp_path / "a.tif", np.repeat(fine[..., None], 4, axis=2).astype(dtype))
    colour, alpha = load_reduced(tmp_path / "a.tif", 80)
    assert colour.shape == (60, 80, 3) and alpha.shape == (60, 80)
    assert np.ptp(colour) <= 2 and abs(float(colour.mean()) - 127.5) < 2
    assert np.ptp(alpha) <= 2
