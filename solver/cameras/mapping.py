"""COLMAP's models of a database: the largest, with as many of the photos as there is any evidence for."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .folder import FEWEST_PHOTOS

FEWEST_SEEN_POINTS = 15
"""known points that a photo has to show to be placed, where COLMAP's 30 leave some out: around a corner,
or on what shines, there are few; half as many have placed 14 of 14 photos of a box where 30 placed 7"""


@dataclass(frozen=True)
class Mapper:
    """COLMAP's incremental mapping.

    Attributes:
        colmap: the module.
        output: folder that COLMAP writes models to.
        token: by which COLMAP is stopped.
        check: raises if it was; called when a model is there.
    """

    colmap: Any
    output: Path
    seed: int
    threads: int
    token: Any
    check: Callable[[], None]

    def largest_model(self, database: Path, wanted: set[str], told: Callable[[int], None]) -> Any:
        """The largest model that the matches of a database give, or None; where it lacks some of the photos
        that are `wanted`, one that asks for less evidence of each, if it has more cameras.

        Args:
            told: how many cameras have been placed.
        """
        best = self._model(database, told, None)
        if best is not None and wanted <= placed_in(best):
            return best
        more = self._model(database, told, FEWEST_SEEN_POINTS)
        if best is None or (more is not None and more.num_reg_images() > best.num_reg_images()):
            return more
        return best

    def _model(self, database: Path, told: Callable[[int], None], fewest_seen_points: int | None) -> Any:
        """The largest of the models from one go of COLMAP's; None for its own number of points."""
        self.output.mkdir(parents=True, exist_ok=True)
        options = self.colmap.IncrementalPipelineOptions()
        options.random_seed, options.num_threads = self.seed, self.threads
        options.mapper.random_seed = options.triangulation.random_seed = self.seed
        options.min_model_size, options.extract_colors = FEWEST_PHOTOS, False
        if fewest_seen_points is not None:
            options.mapper.abs_pose_min_num_inliers = fewest_seen_points
        placed = 0

        def again() -> None:
            nonlocal placed
            placed = 2

        def one_more() -> None:
            nonlocal placed
            placed += 1
            told(placed)

        found = self.colmap.incremental_mapping(
            database, Path(), self.output, options=options,
            initial_image_pair_callback=again, next_image_callback=one_more,
            cancellation_token=self.token,
        )  # fmt: skip
        self.check()
        return max(found.values(), key=lambda m: (m.num_reg_images(), m.num_points3D()), default=None)


def placed_in(model: Any) -> set[str]:
    """Names, in the database or the model's own, of the photos that have a camera in it."""
    return {image.name for image in model.images.values() if image.has_pose}
