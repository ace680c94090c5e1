"""A session folder made from images or videos that another program recorded."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError
from spherecal.base.file_reading import read_file
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.session import UNMEASURED_PRINT, Session
from spherecal.geometry.camera import LensModel
from spherecal.targets.blobs import GreyImage
from spherecal.targets.image_facts import ImageFacts, image_facts
from spherecal.targets.images import read_image
from spherecal.targets.target_set import TargetSet
from spherecal_app.recordings.image_layout import ImageLayout, recognise
from spherecal_app.recordings.video_frames import choose_frames, frame_times, grey_frames, keep_frames
from spherecal_boards.board_images import eight_bits, look_for_board, spread
from spherecal_boards.looking import LOOKED_AT, as_text
from spherecal_files.atomic import SESSION, WRITTEN_FILE, check_folder, write_folder_whole, written_bytes
from spherecal_files.filesystem import write_new
from spherecal_files.json_file import MOST_CAMERAS, json_bytes
from spherecal_files.read_session import FORMAT, SESSION_FILE, VERSION, read_session
from spherecal_files.session_json import ASSUMED_FOCAL, assumed_prior, centred_matrix
from spherecal_files.target_set_file import TARGETS

STAGE = "reading images"
TARGETS_FILE = "targets.json"
_MOST_BYTES = 1 << 30
# Focal lengths of one camera that differ by more are of a zoom lens that was turned; EXIF rounds to 1 %.
_ZOOMED = 0.02


@dataclass(frozen=True)
class StatedCameras:
    """What the user says of all cameras; it takes precedence over what their images hold."""

    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    lens_model: LensModel | None = None


@dataclass(frozen=True)
class Contents:
    """What the session holds besides images."""

    board: Mapping[str, Any] | None = None  # the entry `board` of session.json
    targets: TargetSet | None = None
    sphere_diameter_mm: float | None = None
    spacing_mm: tuple[float, float] | None = None  # of targets, on the print, U (k = 2)
    seen_board: bool = False  # `board` lacks rows and columns, which its images show


@dataclass(frozen=True)
class NewCamera:
    """A camera of a new session: how many images, their size, its focal length and where that comes from."""

    id: str
    images: int
    image_size: tuple[int, int]
    focal_px: float
    focal_from: str  # in words: given, EXIF or assumed
    model: str | None = None  # EXIF's, None where the images do not agree on one; so is the serial number
    serial: str | None = None


@dataclass(frozen=True)
class NewSession:
    """A session made from images: how its files were read, what was assumed, what it still lacks, what was left out."""

    session: Session
    layout: str
    pattern: str
    cameras: tuple[NewCamera, ...]
    assumed: tuple[str, ...]
    missing: tuple[str, ...]
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        images = sum(camera.images for camera in self.cameras)
        words = [
            f"{counted(len(self.cameras), 'camera')}, {counted(len(self.session.placements), 'placement')}, "
            f"{counted(images, 'image')} ({self.layout})",
            *(f"assumed: {one}" for one in self.assumed),
            *(f"missing: {one}" for one in self.missing),
        ]
        return f"<NewSession {self.session.folder}: {'; '.join(words)}>"


def make_session(
    folder: Path,
    source: Path,
    pattern: str | None,
    contents: Contents,
    known: StatedCameras,
    frames: int,
    context: Context,
) -> NewSession:
    """Make a session folder of images or videos' frames, copied unless they are in it; all or nothing."""
    inside = Path(os.path.realpath(source)).is_relative_to(os.path.realpath(folder))
    if inside and (folder / SESSION_FILE).exists():
        raise OutputError(Phrase("error-has-already", {"folder": folder, "name": SESSION_FILE}))
    if not inside:
        check_folder(folder, SESSION)
    layout = recognise(source, pattern)
    if len(layout.files) > MOST_CAMERAS:
        found = {"folder": source, "count": len(layout.files), "pattern": layout.pattern}
        raise InputError(Phrase("error-many-cameras-read", found))
    maker = _OfVideos(source, layout, frames, context) if layout.videos else _OfImages(source, layout, context)
    if inside and layout.videos:
        raise InputError(Phrase("error-folder-of-videos", {"folder": folder}))
    looked: tuple[str, ...] = ()
    if contents.seen_board and contents.board is not None:
        context.report("looking for the board", 0.0)
        board = look_for_board([eight_bits(image) for image in maker.samples(LOOKED_AT)], contents.board)
        contents = replace(contents, board=board)
        looked = (f"the board as its images show it: --board {as_text(board)}",)
    document, cameras, assumed = _document(maker, contents, known)
    beside: dict[str, bytes] = {} if contents.targets is None else {TARGETS_FILE: TARGETS.bytes(contents.targets)}
    if inside:
        session = _write_beside(folder, source, document, maker, beside)
    else:
        session = _write_new_folder(folder, document, maker, beside)
    return NewSession(
        session, layout.words, layout.pattern, cameras, (*looked, *assumed),
        _missing(contents, layout, len(maker.places)), layout.left_out,
    )  # fmt: skip


class _OfImages:
    """Images by camera and placement, copied as they are."""

    def __init__(self, source: Path, layout: ImageLayout, context: Context) -> None:
        self.facts: dict[str, list[tuple[str, ImageFacts]]] = {}
        self.places = layout.placements
        self._source, self._layout, self._context = source, layout, context
        count, done = sum(map(len, layout.files.values())), 0
        for camera, own in layout.files.items():
            for path in own.values():
                context.report(STAGE, done / count, path)
                done += 1
                self.facts.setdefault(camera, []).append((path, image_facts(source / path)))
                read_image(source / path)  # what cannot be calibrated is refused now

    def samples(self, most: int) -> Sequence[GreyImage]:
        """Some images of all cameras and placements."""
        paths = [path for own in self._layout.files.values() for path in own.values()]
        return [read_image(self._source / paths[i]) for i in spread(len(paths), most)]

    def images(self, place: str) -> dict[str, str]:
        """Which files the placement has in the new folder, by camera."""
        return {
            camera: f"placements/{place}/{camera}{PurePosixPath(own[place]).suffix.lower()}"
            for camera, own in self._layout.files.items()
            if place in own
        }

    def below(self, prefix: str, place: str) -> dict[str, str]:
        """Which files it has where they are now, `prefix` before their paths."""
        return {camera: prefix + own[place] for camera, own in self._layout.files.items() if place in own}

    def copy(self, put: Callable[[str, bytes], None]) -> None:
        """Hand over all files under their new names."""
        for number, place in enumerate(self.places):
            self._context.report("copying images", number / len(self.places), place)
            for camera, name in self.images(place).items():
                put(name, read_file(self._source / self._layout.files[camera][place], _MOST_BYTES))


class _OfVideos:
    """Frames of videos that are synchronised, or have the times of their frames beside them."""

    def __init__(self, source: Path, layout: ImageLayout, most: int, context: Context) -> None:
        self._videos = {camera: source / next(iter(own.values())) for camera, own in layout.files.items()}
        if any(len(own) > 1 for own in layout.files.values()):
            raise InputError(Phrase("error-several-videos", {"folder": source}))
        known = frame_times(self._videos)
        chosen = choose_frames(self._videos, most, context, None if known is None else known[1])
        self._numbers = chosen.numbers
        self.places = tuple(f"F{frame:06d}" for frame in next(iter(chosen.numbers.values())))
        self.facts = {
            camera: [(path.name, ImageFacts(chosen.sizes[camera]))] * len(self.places)
            for camera, path in self._videos.items()
        }
        self.moments = "frame i of every video is of one moment (synchronisation is left to other programs)"
        if known is not None and chosen.apart_s is not None:
            apart = f"at most {1e3 * chosen.apart_s:.3g} ms apart"
            self.moments = f"frames are of one moment by the times in {known[0].name}, {apart}"
        elif chosen.rates and chosen.apart_s is not None:
            rates = ", ".join(f"{camera} {rate:g}" for camera, rate in chosen.rates.items())
            self.moments = (
                f"the videos begin together, their rates differ ({rates} frames a second): frames of a moment are "
                f"up to {1e3 * chosen.apart_s:.3g} ms apart; if they were triggered together, give all one rate"
            )
        self._context = context

    def samples(self, most: int) -> Sequence[GreyImage]:
        """Some of the chosen frames of the first video."""
        camera, path = next(iter(self._videos.items()))
        own = self._numbers[camera]
        return grey_frames(path, [own[i] for i in spread(len(own), most)])

    def images(self, place: str) -> dict[str, str]:
        return {camera: f"placements/{place}/{camera}.png" for camera in self._videos}

    def copy(self, put: Callable[[str, bytes], None]) -> None:
        for camera, path in self._videos.items():
            place = dict(zip(self._numbers[camera], self.places, strict=True))
            keep_frames(
                path,
                self._numbers[camera],
                lambda frame, data, c=camera, place=place: put(f"placements/{place[frame]}/{c}.png", data),
                self._context,
            )


_Maker = _OfImages | _OfVideos


# --- session.json ----------------------------------------------------------------------------------------------------


def _document(
    maker: _Maker, contents: Contents, known: StatedCameras
) -> tuple[dict[str, Any], tuple[NewCamera, ...], tuple[str, ...]]:
    """session.json without its placements' images, the cameras as they are shown, and what was assumed."""
    entries, cameras = [], []
    assumed: dict[str, list[str]] = {}
    for camera, facts in maker.facts.items():
        entry, shown, said = _camera(camera, facts, known)
        entries.append(entry)
        cameras.append(shown)
        for one in said:
            assumed.setdefault(one, []).append(camera)
    if isinstance(maker, _OfVideos):
        assumed[maker.moments] = []
    serials = [camera.serial for camera in cameras if camera.serial is not None]
    for serial in serials:
        own = [camera.id for camera in cameras if camera.serial == serial]
        if len(own) > 1:
            raise InputError(Phrase("error-serial-of-two", {"serial": serial, "cameras": own}))
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "cameras": entries}
    if contents.targets is not None:
        document["target_set"] = TARGETS_FILE
    if contents.sphere_diameter_mm is not None:
        document["sphere"] = {"nominal_diameter_mm": contents.sphere_diameter_mm}
    if contents.board is not None:
        document["board"] = dict(contents.board)
    elif (scale := _printed_scale(contents)) is not None:
        document["scale"] = scale
        spacing = f"{scale['from']} to {scale['to']}, {scale['distance_mm']:.3f} mm"
        if contents.spacing_mm is None:
            percent = 100 * UNMEASURED_PRINT
            what = f"the scale by the targets as they should be printed ({spacing}), good to {percent:g} % (k = 1)"
            assumed[f"{what}; state what they measure: --spacing MM,U"] = []
    document["placements"] = [{"id": place} for place in maker.places]
    said = tuple(f"{one} ({', '.join(who)})" if who else one for one, who in assumed.items())
    return document, tuple(cameras), said


def _printed_scale(contents: Contents) -> dict[str, Any] | None:
    """The scale by the targets' nominal spacing, good to what the printer is; None without targets."""
    widest = None if contents.targets is None else contents.targets.widest()
    if widest is None:
        return None
    surface = "flat" if contents.sphere_diameter_mm is None else "sphere"
    scale = {"kind": "target_spacing", "from": widest[0], "to": widest[1], "distance_mm": widest[2], "surface": surface}
    if contents.spacing_mm is None:
        return scale
    return scale | {"distance_mm": contents.spacing_mm[0], "expanded_uncertainty_mm": contents.spacing_mm[1]}


def _camera(
    camera: str, facts: Sequence[tuple[str, ImageFacts]], known: StatedCameras
) -> tuple[dict[str, Any], NewCamera, list[str]]:
    """A camera's entry of session.json, what is shown of it, and what was assumed."""
    first, size = facts[0][0], facts[0][1].size
    for path, one in facts:
        if one.size != size:
            sizes = {"width": one.size[0], "height": one.size[1], "other_width": size[0], "other_height": size[1]}
            raise InputError(Phrase("error-other-size", {"camera": camera, "file": path, "other": first, **sizes}))
    said: list[str] = []
    entry: dict[str, Any] = {"id": camera, "image_size": list(size)}
    model, serial = (_common([getattr(one, name) for _, one in facts]) for name in ("model", "serial"))
    entry |= {key: value for key, value in (("serial", serial), ("model", model)) if value is not None}
    focal = known.focal_length_mm or _focal(camera, facts)
    pitch = known.pixel_pitch_um or _common([one.pixel_pitch_um for _, one in facts])
    focal_px, source = _common([one.focal_px for _, one in facts]), "EXIF, 35 mm equivalent"
    if focal is not None and pitch is not None:
        entry |= {"pixel_pitch_um": pitch, "focal_length_mm": focal}
        given = known.focal_length_mm is not None and known.pixel_pitch_um is not None
        focal_px, source = 1000 * focal / pitch, "given" if given else "EXIF"
    else:
        if focal is not None:
            said.append(f"the focal length of {focal:g} mm says nothing without a pixel pitch")
        if pitch is not None:
            said.append(f"the pixel pitch of {pitch:g} um says nothing without a focal length")
        if focal_px is None:
            focal_px, source = ASSUMED_FOCAL * max(size), "assumed"
            said.append(f"a focal length of {ASSUMED_FOCAL:g} times the longer side, as a start")
        entry["prior"] = assumed_prior(size) if source == "assumed" else {"matrix": centred_matrix(focal_px, size)}
    if known.lens_model is not None:
        entry["lens_model"] = known.lens_model
    return entry, NewCamera(camera, len(facts), size, focal_px, source, model, serial), said


def _common(values: Sequence[Any]) -> Any:
    """The value that all images agree on, None where they do not."""
    if any(value is None for value in values):
        return None
    if isinstance(values[0], float):
        return float(np.median(values)) if np.ptp(values) <= _ZOOMED * min(values) else None
    return values[0] if len(set(values)) == 1 else None


def _focal(camera: str, facts: Sequence[tuple[str, ImageFacts]]) -> float | None:
    """The focal length in mm by EXIF; InputError where the lens was zoomed between images."""
    known = [(path, one.focal_length_mm) for path, one in facts if one.focal_length_mm is not None]
    if len(known) < len(facts):
        return None
    (short, least), (long, most) = min(known, key=lambda one: one[1]), max(known, key=lambda one: one[1])
    if most > (1 + _ZOOMED) * least:
        lengths = {"least": least, "long": long, "most": most}
        raise InputError(Phrase("error-zoomed", {"camera": camera, "short": short, **lengths}))
    return float(np.median([focal for _, focal in known]))


def _missing(contents: Contents, layout: ImageLayout, places: int) -> tuple[str, ...]:
    """What a calibration needs or its user will want, and where to state it."""
    said = []
    if contents.board is None and contents.targets is None:
        said.append("what the images show: a board (--board) or coded targets (--targets)")
    if contents.board is None and _printed_scale(contents) is None:
        said.append('a scale: lengths will be arbitrary; add "scale" or bars to session.json (formats.md)')
    if len(layout.files) < 2:
        said.append("a second camera")
    if places < 2:
        said.append("a second placement: all images or frames are of one")
    return tuple(said)


# --- writing ---------------------------------------------------------------------------------------------------------


def _write_new_folder(folder: Path, document: dict[str, Any], maker: _Maker, beside: Mapping[str, bytes]) -> Session:
    def build(new: Path) -> None:
        names = [SESSION_FILE, *beside]

        def put(name: str, data: bytes) -> None:
            write_new(new, name, data)
            names.append(name)

        maker.copy(put)
        placed = [{"id": place, "images": maker.images(place)} for place in maker.places]
        write_new(new, SESSION_FILE, json_bytes(document | {"placements": placed}))
        for name, data in beside.items():
            write_new(new, name, data)
        write_new(new, WRITTEN_FILE, written_bytes(names))
        read_session(new)  # what could not be read again is not put in place

    write_folder_whole(folder, build, SESSION)
    return read_session(folder)


def _write_beside(
    folder: Path, source: Path, document: dict[str, Any], maker: _Maker, beside: Mapping[str, bytes]
) -> Session:
    """Write session.json into the folder that holds the images."""
    assert isinstance(maker, _OfImages)
    real = Path(os.path.realpath(folder))
    prefix = Path(os.path.realpath(source)).relative_to(real).as_posix()
    prefix = "" if prefix == "." else f"{prefix}/"
    placed = []
    for place in maker.places:
        images = maker.below(prefix, place)
        for name in images.values():
            if not Path(os.path.realpath(real / name)).is_relative_to(real):
                raise InputError(Phrase("error-link-outside", {"folder": folder, "name": name}))
        placed.append({"id": place, "images": images})
    for name in beside:
        if (folder / name).exists():
            raise OutputError(Phrase("error-has-already", {"folder": folder, "name": name}))
    for name, data in (*beside.items(), (SESSION_FILE, json_bytes(document | {"placements": placed}))):
        write_new(folder, name, data)
    return read_session(folder)
