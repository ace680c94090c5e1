"""Pictures of a camera's image with the observations that were used drawn over it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Session
from spherecal_documents.report.language import label
from spherecal_documents.report.model import TEXT_MM, Figure, Paragraph, Section
from spherecal_documents.report.style import SOFT, TINY_PT, Labels, PageBox, Sheet, count
from spherecal_files.read_session import SESSION_FILE, read_session
from spherecal_rigs.result_folder import Result

_MOST_PIXELS = 200_000_000
_SHOWN_WIDTH = 1500  # px: as fine as an office printer shows at the width of a page
_HIGHEST_MM, _DETAIL_MM = 130.0, 80.0  # so that both stand on one page
_USED, _ASIDE = "#ffb000", "#ff5aa5"  # both stand out against grey, and from each other in grey


@dataclass(frozen=True)
class Detection:
    """A camera's image of one placement and the image points observed in it."""

    placement: str
    camera: str
    path: Path
    uv: FloatArray
    target: IntArray
    used: BoolArray


def find_session(result: Result, given: Path | None) -> Session | None:
    """The session of a result: the folder given, else one called `session` beside it that fits, or None."""
    if given is not None:
        session = read_session(given)
        if session.input_sha256 != result.rig.input_sha256:
            raise InputError(Phrase("error-not-results-session", {"folder": given, "file": result.folder / "rig.json"}))
        return session
    folder = result.folder.resolve()
    for guess in (folder.parent / "session", folder.parent):
        if not (guess / SESSION_FILE).is_file():
            continue
        try:
            session = read_session(guess)
        except InputError:
            continue
        if session.input_sha256 == result.rig.input_sha256:
            return session
    return None


def choose_detections(result: Result, session: Session | None) -> list[Detection]:
    """The images to show: that with the most observations used, then one of another camera and placement."""
    if session is None:
        return []
    residuals = result.residuals
    placements, cameras = (np.array(names, dtype=object) for names in (residuals.placement, residuals.camera))
    places = [*session.placements, *session.bar_poses]
    images = {(place.id, camera): path for place in places for camera, path in place.images.items()}
    found = []
    for (placement, camera), path in images.items():
        own = (placements == placement) & (cameras == camera) & np.isfinite(residuals.predicted[:, 0])
        own &= np.isfinite(residuals.du_dv[:, 0])
        if own.any():
            uv = (residuals.predicted - residuals.du_dv)[own]
            found.append(Detection(placement, camera, path, uv, residuals.target[own], residuals.used[own]))
    found.sort(key=lambda d: (-int(d.used.sum()), d.placement, d.camera))
    chosen: list[Detection] = []
    for detection in found:
        if all(detection.camera != c.camera and detection.placement != c.placement for c in chosen):
            chosen.append(detection)
    return chosen[:2]


def detection_sections(result: Result, detections: Sequence[Detection]) -> list[Section]:
    """A section for each image: the whole with target numbers, and a detail of it."""
    sections = []
    for detection in detections:
        image = read_grey(detection.path)
        _check_size(image, detection, result)
        height, width = image.shape
        wide = min(TEXT_MM, _HIGHEST_MM * width / height)
        title = label("report-detection-placement", camera=detection.camera, placement=detection.placement)
        parts = {"image": image, "detection": detection}
        whole = Figure(title, wide * height / width, partial(_draw_detection, **parts), wide)
        detail = Figure(label("report-detection-detail"), _DETAIL_MM, partial(_draw_detail, **parts))
        blocks = (Paragraph(_caption(detection), "note"), whole, Paragraph(detail.name, "subtitle"), detail)
        sections.append(Section("detection", title, blocks, new_page=True))
    return sections


def _caption(detection: Detection) -> str:
    """What the picture shows."""
    used = int(detection.used.sum())
    aside = len(detection.used) - used
    note = label("report-set-aside", count=count(aside)) if aside else ""
    targets = len(np.unique(detection.target))
    return label("report-detection-caption", used=count(used), targets=targets, aside=note)


def _check_size(image: NDArray[np.uint8], detection: Detection, result: Result) -> None:
    camera = result.rig.camera(detection.camera)
    height, width = image.shape
    if camera is not None and camera.image_size != (width, height):
        size = f"{camera.image_size[0]} x {camera.image_size[1]}"
        raise InputError(
            Phrase("error-page-image", {"file": detection.path, "width": width, "height": height, "size": size})
        )


def read_grey(path: Path) -> NDArray[np.uint8]:
    """An image as grey values with its contrast stretched; orientation tags are ignored."""
    try:
        with Image.open(path) as image:
            if image.width * image.height > _MOST_PIXELS:
                raise InputError(Phrase("error-image-large", {"file": path, "most": _MOST_PIXELS // 1_000_000}))
            deep = image.mode.startswith(("I", "F"))
            values = np.asarray(image if deep else image.convert("L"), dtype=np.float32)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, ValueError, SyntaxError) as error:
        raise InputError(Phrase("error-image-unreadable", {"file": path, "why": str(error)})) from error
    low, high = np.quantile(values[::4, ::4], (0.002, 0.998))
    stretched = (values - low) / max(float(high - low), 1e-6)
    return (255 * np.clip(stretched, 0, 1) ** 0.8).astype(np.uint8)


def _draw_detection(sheet: Sheet, box: PageBox, image: NDArray[np.uint8], detection: Detection) -> None:
    """The whole image with a circle for each observation and the numbers of the targets."""
    height, width = image.shape
    shown = image
    if width > _SHOWN_WIDTH:
        size = (_SHOWN_WIDTH, round(_SHOWN_WIDTH * height / width))
        shown = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
    axes = _picture(sheet, box, shown, (-0.5, width - 0.5, height - 0.5, -0.5))
    _mark(axes, detection, 1.9, 0.35)
    _number(axes, box.width / width, detection, np.array([[0.0, 0.0], [width, height]]), 4.5)


def _number(axes: Axes, mm_per_px: float, detection: Detection, window: FloatArray, size_pt: float) -> None:
    """The targets' numbers beside them, within a window [[left, top], [right, foot]] of the image."""
    flipped = np.array([1.0, -1.0])
    bounds = np.array([[window[0, 0], -window[1, 1]], [window[1, 0], -window[0, 1]]])
    labels = Labels(axes, mm_per_px, detection.uv * flipped, bounds)
    labels.over_image()
    for target in np.unique(detection.target).tolist():
        own = detection.uv[detection.target == target]
        if not ((own.mean(axis=0) > window[0]) & (own.mean(axis=0) < window[1])).all():
            continue
        middle = own.mean(axis=0) * flipped
        reach = 0.5 * float(np.ptp(own, axis=0).max(initial=0.0)) * mm_per_px
        labels.put(middle, str(target), np.array([1.0, 0.0]), size_pt, _USED, gap_mm=0.6 * reach + 0.8)


def _draw_detail(sheet: Sheet, box: PageBox, image: NDArray[np.uint8], detection: Detection) -> None:
    """The part of the image around its densest place, so large that single dots are seen."""
    height, width = image.shape
    part = 0.16 * width
    size = np.array([part, part * (box.height - 4.0) / box.width])
    used = detection.uv[detection.used] if detection.used.any() else detection.uv
    near = [(np.abs(used - place) < size / 2).all(axis=1).sum() for place in used]
    middle = used[int(np.argmax(near))]
    low = np.clip(middle - size / 2, 0, np.maximum(np.array([width, height]) - size, 0))
    left, top = np.floor(low).astype(int)
    right, foot = np.minimum(np.ceil(low + size).astype(int), [width, height])
    cut = image[top:foot, left:right]
    strip, box = box, box.inset(0.0, 4.0)
    axes = _picture(sheet, box, cut, (left - 0.5, right - 0.5, foot - 0.5, top - 0.5))
    axes.set_xlim(low[0] - 0.5, low[0] + size[0] - 0.5)
    axes.set_ylim(low[1] + size[1] - 0.5, low[1] - 0.5)
    _mark(axes, detection, 4.0, 0.6, cross=True)
    _number(axes, box.width / part, detection, np.vstack([low, low + size]), 7.0)
    place = label("report-u-to-v-to-px", left=left, right=right, top=top, foot=foot)
    sheet.text(strip.x + strip.width, strip.y + 2.5, place, TINY_PT, colour=SOFT, align="right")


def _picture(sheet: Sheet, box: PageBox, image: NDArray[np.uint8], extent: tuple[float, float, float, float]) -> Axes:
    axes = sheet.axes(box)
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, aspect="auto", interpolation="none")
    axes.set_axis_off()
    axes.autoscale(False)
    return axes


def _mark(axes: Axes, detection: Detection, size_pt: float, line_pt: float, cross: bool = False) -> None:
    for chosen, mark, colour in ((detection.used, "+" if cross else "o", _USED), (~detection.used, "x", _ASIDE)):
        axes.plot(
            *detection.uv[chosen].T, linestyle="none", marker=mark, markersize=size_pt, markerfacecolor="none",
            markeredgecolor=colour, markeredgewidth=line_pt,
        )  # fmt: skip
