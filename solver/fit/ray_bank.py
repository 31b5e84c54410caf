"""All pixels of a capture as rays with their targets, drawn in batches."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..capture.backdrop import LEVELS, TOLERANCE
from ..capture.camera import Camera
from ..capture.photos import Photo
from ..kernels.sending import constant_on, sent
from ..render.arrays import floats_on
from ..render.pixels import places_in_pixel
from ..render.tonemap import linear_to_srgb


class RayBatch(NamedTuple):
    """Rays of B pixels, n each, and what the photos show there."""

    origins: Tensor  # [B, 3] world
    directions: Tensor  # [B, n, 3] world, unit
    colour: Tensor  # [B, 3] sRGB-encoded, straight (not premultiplied)
    alpha: Tensor  # [B] coverage; 1 where the photo has none
    alpha_known: Tensor  # [B] false where it may as well be 0: as plain as the backdrop
    clipped: Tensor  # [B, 3] true where the photo is saturated
    pixel_angle: Tensor  # [B] angular width of the pixel, rad
    photo: Tensor  # [B] long, index of the photo
    behind: Tensor | None = None  # [B, 3] sRGB-encoded, far behind the object, if known

    def split(self, sizes: list[int]) -> "list[RayBatch]":
        """Batches of so many pixels each."""
        pieces = [[None] * len(sizes) if values is None else values.split(sizes) for values in self]
        return [RayBatch(*some) for some in zip(*pieces, strict=True)]


class RayBank:
    """Pixels of all photos: directions in camera axes are stored once per lens, colours in half.

    Args:
        cameras, photos: matching lists. What photos say nothing of (`Photo.told`) is never drawn.
    """

    BACKGROUND_SHARE = 0.05

    def __init__(self, cameras: list[Camera], photos: list[Photo], device="cpu"):
        self.device = device
        lenses: dict[tuple, int] = {}
        directions, self.first_pixel = [], [0]
        stored = 0
        lens_start: list[int] = []
        colours, alphas, behind = [], [], []
        for camera, photo in zip(cameras, photos, strict=True):
            key = camera.lens_key
            if key not in lenses:
                lenses[key] = stored
                directions.append(camera_space_directions(camera))
                stored += camera.width * camera.height
            lens_start.append(lenses[key])
            premultiplied = torch.from_numpy(photo.pixels).reshape(-1, 4)
            alpha = premultiplied[:, 3]
            straight = premultiplied[:, :3] / alpha.clamp(min=1e-4)[:, None]
            colours.append(linear_to_srgb(straight).half())
            alphas.append(alpha.half())
            if photo.behind is not None:
                behind.append(torch.from_numpy(photo.behind).reshape(-1, 3).half())
            self.first_pixel.append(self.first_pixel[-1] + camera.width * camera.height)
        self.directions = torch.cat(directions).to(device)
        self.colour = torch.cat(colours).to(device)
        self.alpha = torch.cat(alphas).to(device)
        self.behind = torch.cat(behind).to(device) if behind else None
        self.backdrop = None if photos[0].backdrop is None else LEVELS[photos[0].backdrop]
        self.is_hdr = torch.tensor([photo.is_hdr for photo in photos], device=device)
        self.stand(cameras)
        self.boundaries = torch.tensor(self.first_pixel, device=device)
        self.lens_start = torch.tensor(lens_start, device=device)
        self.told = _told_pixels(photos, device)
        self.likely = self._all_likely = None
        self.size = torch.tensor([[c.width, c.height] for c in cameras], device=device)
        self.preview_camera, self.preview_photo = cameras[0], photos[0].pixels
        self.pixel_angle = torch.tensor(
            [c.pixel_angle for c in cameras], dtype=torch.float32, device=device
        )

    def stand(self, cameras: list[Camera]) -> None:
        """Let rays come from where cameras are, which are those of the photos but for that."""
        matrices = np.stack([camera.camera_to_world for camera in cameras])
        self.rotation, self.position = floats_on(self.device, matrices[:, :3, :3], matrices[:, :3, 3])

    @property
    def photo_count(self) -> int:
        return len(self.first_pixel) - 1

    @property
    def poses(self) -> Tensor:
        """Camera to world [P, 3, 4] of the photos."""
        return torch.cat([self.rotation, self.position[..., None]], -1)

    @cached_property
    def mean_colours(self) -> Tensor:
        """Each photo's mean colour [P, 3] where it says something, sRGB-encoded: by it a photo is known
        again."""
        photos = self.colour.split(np.diff(self.first_pixel).tolist())
        if self.told is not None:
            photos = (self.colour[self._those_of(self.told, i)] for i in range(self.photo_count))
        return torch.stack([photo.float().mean(0) for photo in photos])

    def __len__(self) -> int:
        return self.first_pixel[-1]

    def _photo_of(self, pixel: Tensor) -> Tensor:
        return torch.searchsorted(self.boundaries, pixel, right=True) - 1

    def _through(self, pixel: Tensor, photo: Tensor, grid: int) -> Tensor:
        """Unit world directions [B, grid², 3] through pixels of photos [B]; beside the centres by the
        step to the next pixel, which a lens changes slowly."""
        first, local = self.lens_start[photo], pixel - self.boundaries[photo]
        centre = self.directions[first + local]
        directions = centre[:, None]
        if grid > 1:
            width, height = self.size[photo].unbind(-1)
            row, column = local // width, local % width
            # The last pixel of a row or column has the step of the one before it.
            left, above = torch.minimum(column, width - 2), torch.minimum(row, height - 2)
            across, down = first + row * width + left, first + above * width + column
            ends, starts = torch.stack([across + 1, down + width]), torch.stack([across, down])
            step = self.directions[ends] - self.directions[starts]
            places = constant_on(step.device, tuple(map(tuple, places_in_pixel(grid).tolist())))
            directions = directions + torch.einsum("nk,kbj->bnj", places, step)
            directions = torch.nn.functional.normalize(directions, dim=-1)
        return torch.einsum("bij,bnj->bni", self.rotation[photo], directions)

    def batch(self, pixel: Tensor, grid: int = 1) -> RayBatch:
        """Rays, grid × grid through a pixel, and targets of global pixel indices [B]."""
        photo = self._photo_of(pixel)
        directions = self._through(pixel, photo, grid)
        colour = self.colour[pixel].float()
        alpha = self.alpha[pixel].float()
        clipped = (colour >= 0.998) & ~self.is_hdr[photo][:, None]
        known = torch.ones_like(alpha, dtype=torch.bool)
        if self.backdrop is not None:
            # The backdrop seen through a handle, or a highlight as white as it.
            known = (alpha < 1) | ((colour - self.backdrop).abs() > TOLERANCE).any(-1)
        behind = None if self.behind is None else self.behind[pixel].float()
        return RayBatch(
            self.position[photo], directions, colour, alpha, known, clipped, self.pixel_angle[photo], photo,
            behind,
        )  # fmt: skip

    def restrict(self, likely: Tensor) -> None:
        """Draw mostly from the pixels in `likely` [P] bool (rays that can meet the object)."""
        if self.told is not None:
            told = torch.zeros_like(likely)
            told[self.told.to(likely.device)] = True
            likely = likely & told
        self.likely = self._all_likely = likely.nonzero()[:, 0].to(self.device)

    def leave_out(self, pixels: Tensor) -> None:
        """Draw global pixel indices [K] hardly ever from now on, and what was left out before as often as
        others again."""
        counts = torch.ones(len(self), dtype=torch.bool, device=self.device)
        counts[pixels] = False
        self.likely = self._all_likely[counts[self._all_likely]]

    def are_likely(self, pixels: np.ndarray) -> np.ndarray:
        """[K] bool: which of some global pixel indices were drawn mostly, before any was left out."""
        return np.isin(pixels, self._all_likely.cpu().numpy())

    def counted_by_photo(self, pixels: Tensor) -> np.ndarray:
        """How many [P] of some global pixel indices are each photo's."""
        return torch.bincount(self._photo_of(pixels), minlength=self.photo_count).cpu().numpy()

    def draw(self, count: int, generator: torch.Generator, photo: int | None = None) -> Tensor:
        """Random global pixel indices [count]; of one photo only, if that is given."""
        likely = self.likely
        if likely is not None and photo is not None:
            likely = self._those_of(likely, photo)
        if likely is None or len(likely) == 0:
            return self._anywhere(count, generator, photo)
        background = int(count * self.BACKGROUND_SHARE)
        chosen = torch.randint(len(likely), (count - background,), generator=generator)
        anywhere = self._anywhere(background, generator, photo)
        return torch.cat([likely[sent(chosen, self.device)], anywhere])

    def _anywhere(self, count: int, generator: torch.Generator, photo: int | None) -> Tensor:
        """Random global pixel indices [count], of all or of one photo's that are told."""
        if self.told is not None:
            told = self.told if photo is None else self._those_of(self.told, photo)
            chosen = torch.randint(len(told), (count,), generator=generator)
            return told[sent(chosen, self.device)]
        first, last = (0, len(self)) if photo is None else self.first_pixel[photo : photo + 2]
        return sent(torch.randint(first, last, (count,), generator=generator), self.device)

    def _those_of(self, pixels: Tensor, photo: int) -> Tensor:
        """Which of some global pixel indices, in their order, are a photo's."""
        ends = pixels.new_tensor(self.first_pixel[photo : photo + 2])
        begin, end = torch.searchsorted(pixels, ends).tolist()
        return pixels[begin:end]

    def draw_photo(self, generator: torch.Generator) -> int:
        """A random photo, as often as its pixels are drawn."""
        return int(self._photo_of(self.draw(1, generator))[0])


def _told_pixels(photos: list[Photo], device: str) -> Tensor | None:
    """Global indices [T] of the pixels that photos say something of, in their order; None: of all."""
    if all(photo.told is None for photo in photos):
        return None
    told = [
        np.ones(photo.pixels.shape[0] * photo.pixels.shape[1], bool)
        if photo.told is None
        else photo.told.ravel()
        for photo in photos
    ]
    return torch.from_numpy(np.flatnonzero(np.concatenate(told))).to(device)


def camera_space_directions(camera: Camera) -> Tensor:
    """Unit directions [H·W, 3] of the pixel centres in camera axes."""
    row, column = np.mgrid[0 : camera.height, 0 : camera.width]
    _, directions = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
    return torch.from_numpy(directions @ camera.camera_to_world[:3, :3]).float()
