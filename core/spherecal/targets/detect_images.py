"""Detection over many image files, on several cores."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.images import check_size, read_image
from spherecal.targets.target_set import TargetSet

STAGE = "detect"
_PATIENCE_S = 0.1  # between looks at the user's wish to stop


Known = Sequence[DetectionSettings | None] | None  # what is known of each image's camera


def detect_images(
    paths: Sequence[Path], targets: TargetSet, context: Context | None = None, workers: int = 2, settings: Known = None
) -> list[Detections]:
    """The targets in every image file, in the order of `paths`; not dependent on the number of threads."""
    context = context or Context()
    context.report(STAGE, 0.0, Phrase("images", {"images": len(paths)}))
    detector = Detector(targets)
    cameras = settings if settings is not None else [None] * len(paths)
    pool = ThreadPoolExecutor(max_workers=max(workers, 1), thread_name_prefix=STAGE)
    try:
        futures = [pool.submit(_detect_file, detector, *job) for job in zip(paths, cameras, strict=True)]
        _follow(futures, context)
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _detect_file(detector: Detector, path: Path, settings: DetectionSettings | None) -> Detections:
    image = read_image(path)
    if settings is not None and settings.image_size is not None:
        check_size(path, image, settings.image_size)
    return detector.detect(image, settings)


def _follow(futures: Sequence[Future[Detections]], context: Context) -> None:
    """Wait for all, reporting progress; raises at the first failure or when the user asked to stop."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, timeout=_PATIENCE_S, return_when="FIRST_COMPLETED")
        context.check()
        for future in done:
            future.result()
        if done:
            finished = len(futures) - len(pending)
            where = Phrase("image-of", {"number": finished, "images": len(futures)})
            context.report(STAGE, finished / len(futures), where)
