"""Cameras from photos, with pycolmap on the CPU: features, matches, cameras, bundle adjustment.

Imports pycolmap only when it is used. Every step stops within seconds when asked,
and what a stopped or killed solve has put into the database is not computed again.
"""

import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..capture.errors import CaptureError, listed
from ..capture.mask_finder import none_fits
from ..capture.photo_matches import match_pairs, opened, quiet_colmap
from ..job.control import Cancelled, Control
from ..job.progress import Progress
from ..streams import silent_stderr
from ..threads import thread_pool, usable_cores
from .database import evidence_of, has_features, numbers, register
from .diagnosis import Evidence, unplaced
from .folder import FEWEST_PHOTOS, SolveFolder, SolveRequest
from .mapping import FEWEST_SEEN_POINTS, Mapper, placed_in
from .model import finish_model
from .output import write_cameras
from .pairs import pairs_of
from .prepare import Prepared, look_at, write_prepared
from .room import check_room
from .walk import misled, walked_model

SHARES = {"features": 0.3, "matching": 0.45, "mapping": 0.2, "adjustment": 0.05}
SHARES_OF_VIDEO = {"video": 0.15} | {stage: 0.85 * share for stage, share in SHARES.items()}
FEWEST_FEATURES = 16
_BLOCK_SECONDS = 2.0


@dataclass(frozen=True)
class Solved:
    """What came out.

    Attributes:
        photos, placed: how many there are, and how many have a camera.
        warning: what to know about the others, one sentence; or empty.
    """

    photos: int
    placed: int
    points: int
    warning: str


class Solver:
    """One solve in its folder.

    Args:
        folder: taken (`SolveFolder.take`).
        control: started.
    """

    def __init__(self, folder: SolveFolder, request: SolveRequest, progress: Progress, control: Control):
        self.colmap = quiet_colmap()
        self.folder, self.request = folder, request
        # As COLMAP is told them, from within the folder: on Windows it opens no path with letters that the
        # system's code page has not.
        self.database = Path(folder.database_path.name)
        self.work = Path(folder.work_dir.name)
        self.progress, self.control = progress, control
        self.token = self.colmap.CancellationToken()
        self.threads = usable_cores()
        self.mapper = Mapper(
            self.colmap, self.work / "models", request.seed, self.threads, self.token, self._check
        )

    def run(self) -> Solved:
        """Do all that is left to do.

        Raises:
            Cancelled: asked to stop; the next run goes on. CaptureError: photos that make no cameras, or
                a disk that is full; then the next run goes on, too.
        """
        with chdir(self.folder.root):
            try:
                return self._run()
            except CaptureError:
                if not has_features(self.colmap, self.database):
                    self.folder.drop_database()
                raise

    def _run(self) -> Solved:
        root = Path(self.request.photos)
        masks, ignored = (
            None if path is None else Path(path) for path in (self.request.masks, self.request.ignored)
        )
        photos = look_at(root, self.request.names, masks, self.request.max_image_size, ignored)
        if masks is not None:
            self._tell_of_missing_masks(masks, photos)
        shutil.rmtree(self.work, ignore_errors=True)
        self.colmap.set_random_seed(self.request.seed)
        self._check()
        try:
            with self._stopping():
                register(self.colmap, self.database, photos, self.request)
                self._features(photos)
                self._match(photos)
                model = self._map(photos)
                model = self._unfolded(photos, model)
                self._adjust(model)
        finally:
            shutil.rmtree(self.work, ignore_errors=True)
        return self._write(photos, model)

    def _tell_of_missing_masks(self, masks: Path, photos: list[Prepared]) -> None:
        without = [photo.name for photo in photos if photo.mask is None]
        if len(without) == len(photos):
            raise none_fits(masks, photos[0].name)
        if without:
            self.progress.warning(
                f"no mask for {len(without)} of {len(photos)} photos ({listed(without)}), so all that "
                "these show is used"
            )

    @contextmanager
    def _stopping(self) -> Iterator[None]:
        """Hand the wish to stop on to COLMAP."""
        done = threading.Event()

        def watch() -> None:
            while not done.wait(0.1):
                if self.control.should_stop:
                    self.token.cancel()

        threading.Thread(target=watch, daemon=True).start()
        try:
            yield
        except InterruptedError as error:
            raise Cancelled from error
        finally:
            done.set()

    def _check(self, pictures: int = 0) -> None:
        """Whether to go on, also with so many pictures that lie in the folder for a while."""
        if self.control.should_stop:
            raise Cancelled
        check_room(self.folder.root, pictures, self.request.max_image_size)

    def _features(self, photos: list[Prepared]) -> None:
        """SIFT features of all photos that have none yet."""
        self.progress.stage("features", "finding features")
        with opened(self.colmap, self.database) as database:
            number = numbers(database)
            left = [p for p in photos if not database.exists_descriptors(number[p.file])]
        options = self.colmap.FeatureExtractionOptions()
        options.num_threads, options.use_gpu = self.threads, False
        options.sift.max_num_features = self.request.max_features
        block = max(4, 2 * self.threads)
        for first in range(0, len(left), block):
            now = left[first : first + block]
            self._check(len(now))
            pictures, masks = self.work / "pictures", self.work / "masks"
            for path in (pictures, masks):
                path.mkdir(parents=True, exist_ok=True)
            with thread_pool(8) as pool:
                list(pool.map(lambda photo, a=pictures, b=masks: write_prepared(photo, a, b), now))
            self._check()
            self._extract(now, pictures, masks, options)
            # Not the folders: on Windows one that is looked at cannot be made again at once.
            for file in (*pictures.iterdir(), *masks.iterdir()):
                with suppress(OSError):
                    file.unlink()
            done = len(photos) - len(left) + first + len(now)
            self.progress.fraction(done / len(photos), f"features: photo {done}")
        evidence = self._evidence(photos)
        if sum(item.features >= FEWEST_FEATURES for item in evidence) < FEWEST_PHOTOS:
            self._fail(evidence)

    def _extract(self, now: list[Prepared], pictures: Path, masks: Path, options: Any) -> None:
        reader = self.colmap.ImageReaderOptions()
        masked = [photo for photo in now if (masks / f"{photo.file}.png").exists()]
        for group, path in ((masked, masks), ([p for p in now if p not in masked], None)):
            if group:
                reader.mask_path = "" if path is None else path
                self.colmap.extract_features(
                    self.database, pictures,
                    image_names=[photo.file for photo in group], reader_options=reader,
                    extraction_options=options, device=self.colmap.Device.cpu,
                    cancellation_token=self.token,
                )  # fmt: skip

    def _match(self, photos: list[Prepared]) -> None:
        """Matches of all pairs that were not compared yet, verified, in blocks of some seconds."""
        self.progress.stage("matching", "matching photos")
        pairs = pairs_of(len(photos), self.request.matcher)
        with opened(self.colmap, self.database) as database:
            number = numbers(database)
            ids = [number[photo.file] for photo in photos]
            left = [(i, j) for i, j in pairs if not database.exists_two_view_geometry(ids[i], ids[j])]
        self.work.mkdir(parents=True, exist_ok=True)
        block, at = 10 * self.threads, 0
        while at < len(left):
            self._check()
            began = time.monotonic()
            now = left[at : at + block]
            match_pairs(
                self.colmap, self.database, self.work,
                [(photos[i].file, photos[j].file) for i, j in now], self.request.seed,
                cancellation_token=self.token,
            )  # fmt: skip
            at += len(now)
            factor = _BLOCK_SECONDS / max(time.monotonic() - began, 1e-3)
            block = min(max(int(block * min(factor, 3.0)), 2 * self.threads), 1000)
            done = len(pairs) - len(left) + at
            self.progress.fraction(done / len(pairs), f"matching: pair {done} of {len(pairs)}")

    def _map(self, photos: list[Prepared]) -> Any:
        """The largest model that the matches give."""
        self.progress.stage("mapping", "placing cameras")
        self._check()
        shutil.rmtree(self.folder.sparse_dir, ignore_errors=True)
        most = 0

        def told(placed: int) -> None:
            nonlocal most
            most = min(max(most, placed), len(photos))
            self.progress.fraction(most / len(photos), f"placing cameras: {most} placed")

        evidence = self._evidence(photos)
        joined = {
            photo.file for photo, item in zip(photos, evidence, strict=True)
            if max(item.matches, default=0) >= 2 * FEWEST_SEEN_POINTS
        }  # fmt: skip
        best = self.mapper.largest_model(self.database, joined, told)
        if best is None or best.num_reg_images() < FEWEST_PHOTOS:
            self._fail(evidence)
        return best

    def _unfolded(self, photos: list[Prepared], model: Any) -> Any:
        """The model, or a better one where things that look alike have misled it."""
        number = {photo.file: photo.number for photo in photos}
        in_one_take = self.request.matcher == "sequential"
        if not misled(self.colmap, self.database, model, number, in_one_take):
            return model

        def told(placed: int) -> None:
            self.progress.fraction(
                1.0, f"photos contradict each other, placing cameras again: {placed} placed"
            )

        copy = self.work / self.database
        shutil.copyfile(self.database, copy)
        walked = walked_model(
            self.colmap, copy, model, number, in_one_take,
            lambda: self.mapper.largest_model(copy, placed_in(model), told),
        )  # fmt: skip
        if walked is None:
            self.progress.warning(
                "consecutive photos do not fit together, so things that look alike may have been "
                "confused; name photos in the order in which they were taken, leave out what comes after a "
                "cut, or take photos in between"
            )
        return model if walked is None else walked

    def _adjust(self, model: Any) -> None:
        self.progress.stage("adjustment", "adjusting all cameras")
        options = self.colmap.BundleAdjustmentOptions()
        options.print_summary = False
        with silent_stderr():
            self.colmap.bundle_adjustment(model, options, cancellation_token=self.token)
        self._check()
        self.progress.fraction(1.0, "cameras solved")

    def _evidence(self, photos: list[Prepared]) -> list[Evidence]:
        return evidence_of(self.colmap, self.database, photos)

    def _fail(self, evidence: list[Evidence]) -> None:
        problem, remedy = unplaced(evidence, set())
        raise CaptureError(self.request.photos, "photos", problem, remedy)

    def _write(self, photos: list[Prepared], model: Any) -> Solved:
        cameras, points = finish_model(self.colmap, model, photos, self.folder)
        problem, remedy = unplaced(self._evidence(photos), placed_in(model))
        write_cameras(self.folder, Path(self.request.photos), cameras)
        return Solved(len(photos), len(cameras), points, f"{problem}; {remedy}" if problem else "")
