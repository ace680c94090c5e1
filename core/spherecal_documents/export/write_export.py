"""`export_rig`: a calibrated rig written in a format of others, read back and compared."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from pathlib import Path

import numpy as np

from spherecal import __version__
from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import EXPORTERS, names
from spherecal.data.rig import Rig, RigCamera, Verdict
from spherecal.data.verdict_words import WORDS, named
from spherecal.geometry.camera import is_fisheye, project, undistort
from spherecal_documents.export.anipose import ANIPOSE, CALISCOPE
from spherecal_documents.export.colmap import COLMAP
from spherecal_documents.export.csv_table import CSV, MAPS
from spherecal_documents.export.file_cameras import MM_PER, FileCamera, FileRig, Pose, Unit
from spherecal_documents.export.format import Format, ImportFormat, exporter
from spherecal_documents.export.kalibr import KALIBR, ROS
from spherecal_documents.export.metashape import METASHAPE
from spherecal_documents.export.mrcal import MC_CALIB, MRCAL, MRCAL_SPLINED, MULTICAL
from spherecal_documents.export.opencv_yaml import OPENCV
from spherecal_documents.export.refit import Box, Loss, dropped, refit
from spherecal_documents.export.scene_formats import SCENES, SceneFormat
from spherecal_documents.export.scene_formats import largest_difference_px as scene_difference_px
from spherecal_files.atomic import Marker, write_file_whole, write_folder_whole
from spherecal_files.filesystem import write_new
from spherecal_files.json_file import json_bytes, software_entry
from spherecal_files.verification_file import Override
from spherecal_rigs.framed_rig import frame_entry, in_frame
from spherecal_rigs.user_frame import UserFrame

_FORMATS = (
    OPENCV, ROS, KALIBR, COLMAP, METASHAPE, ANIPOSE, CALISCOPE, MC_CALIB, MULTICAL, MRCAL, MRCAL_SPLINED, CSV, MAPS,
)  # fmt: skip
FORMATS: dict[str, Format] = {one.name: one for one in _FORMATS}

EXPORT = Marker("export.json", "spherecal/export", listed="files_sha256")

# The paper's residuals have a standard deviation of 0.063 px: a refit that stays below 0.1 px all over the image
# changes a projection hardly more than one dot's noise does.
DEFAULT_MAX_LOSS_PX = 0.1

# A field is known where its standard uncertainty is at most so many times the usual one in its image.
KNOWN = 3.0
_FAILED = "VERIFICATION FAILED"
_CHECK_POINTS = 1000
_SEED = 1


@dataclass(frozen=True)
class FieldLoss:
    """What is lost with a lens' field: its largest where it is known, in px, and in mm at the rig's distance."""

    max_px: float
    max_mm: float


@dataclass(frozen=True)
class Exported:
    """What was written: the cameras' ids there, largest difference after reading back, refits' costs by camera.

    `fields_lost`: by camera, where the format cannot hold a field. Of a scene, whose cameras have no distortion, the
    difference is that of its frusta's corners.
    """

    format: Format | SceneFormat
    unit: Unit
    ids: Sequence[str]
    largest_difference_px: float
    losses: Mapping[str, Loss]
    fields_lost: Mapping[str, FieldLoss] = dataclass_field(default_factory=dict)

    def __repr__(self) -> str:
        lost = f", lenses refitted: {', '.join(self.losses)}" if self.losses else ""
        difference = f"largest difference {self.largest_difference_px:.2g} px"
        return f"<Exported: {self.format.title}, {len(self.ids)} cameras in {self.unit}, {difference}{lost}>"


def export_rig(
    rig: Rig,
    name: str,
    output: Path,
    unit: Unit | None = None,
    max_loss_px: float = DEFAULT_MAX_LOSS_PX,
    frame: UserFrame | None = None,
    volume_mm: Box | None = None,
    override: Override | None = None,
) -> Exported:
    """Write the rig whole to `output` and compare what is read back over 1,000 points in every image.

    Lenses with too many coefficients are refitted (refit.py), over the image or `volume_mm`. `frame` None: the world of
    the rig; `override`: who exports a rig whose verification failed.
    """
    if not rig.cameras:
        raise InputError(Phrase("error-nothing-to-export"))
    if name in SCENES:
        return _write_scene(SCENES[name], rig, output, unit, frame, override)
    form = format_named(name)
    chosen = chosen_unit(form, unit)
    wide = [camera.id for camera in rig.cameras if is_fisheye(camera.intrinsics)]
    if wide and not form.fisheye:
        others = [name for name, one in FORMATS.items() if one.fisheye]
        raise InputError(Phrase("error-no-fisheye", {"format": form.title, "cameras": wide, "others": others}))
    lenses, first = _lenses(rig, form, max_loss_px, volume_mm), None
    if frame is not None:
        rig, first = in_frame(rig, frame), rig.reference_camera
    file_rig, losses = _file_rig(rig, first, chosen, lenses, override)
    lost = {} if form.fields else _field_losses(rig)
    if frame is not None:
        file_rig = replace(file_rig, source=f"{file_rig.source}, user's frame: {frame.definition.words()}")
    _refuse_losses(form, losses, rig, max_loss_px)
    written = form.write(file_rig)
    said = any(_FAILED in text for text in written.values() if isinstance(text, str))
    files = {name: text if isinstance(text, bytes) else text.encode() for name, text in written.items()}
    if override is not None and not form.folder and not said:
        raise InputError(Phrase("error-override-not-said", {"format": form.title}))
    manifest = _manifest(form, files, file_rig, losses, lost, rig.quality.verdict)
    _write(form, files, output, manifest if frame is None else {**manifest, "frame": frame_entry(frame)})
    ids = form.ids(file_rig)
    return Exported(
        form, chosen, ids, largest_difference_px(rig, ids, form.read(output), chosen, form.fields), losses, lost
    )


def _field_losses(rig: Rig) -> dict[str, FieldLoss]:
    """What each camera loses with its field; beyond where the ball was seen the field is not known, and not counted."""
    lost = {}
    middle = np.mean([camera.centre_mm for camera in rig.cameras], axis=0)
    for camera in rig.cameras:
        if (field := camera.field) is None or not (field.du.any() or field.dv.any()):
            continue
        size = np.hypot(field.du, field.dv)
        known = (
            np.ones(size.shape, dtype=bool) if field.sd_px is None else field.sd_px <= KNOWN * np.median(field.sd_px)
        )
        most = float(size[known].max(initial=0.0))
        distance = float(np.linalg.norm(camera.centre_mm - middle)) or 1000.0
        lost[camera.id] = FieldLoss(most, most * distance / float(camera.intrinsics[0]))
    return lost


def format_named(name: str) -> Format:
    """The format of this name, the program's or an installed package's."""
    found = FORMATS.get(name) or exporter(name)
    if found is None:
        others = (one for one in names(EXPORTERS) if one not in FORMATS)
        known = [*FORMATS, *SCENES, *others]
        raise InputError(Phrase("error-no-export-format", {"name": name, "formats": known}))
    return found


def chosen_unit(form: Format | ImportFormat, unit: Unit | None) -> Unit:
    """The unit of lengths: the one given, or the format's usual one."""
    if unit is None:
        return form.units[0]
    if unit not in form.units:
        raise InputError(Phrase("error-fixed-unit", {"format": form.title, "unit": form.units[0]}))
    return unit


_Lenses = Mapping[str, tuple[FloatArray, FloatArray, Loss]]


def _lenses(rig: Rig, form: Format, max_loss_px: float, volume: Box | None) -> _Lenses:
    """The smaller lens, the camera's turn and the loss of each camera whose lens the format cannot hold."""
    found = {}
    for camera in rig.cameras:
        lens = camera.intrinsics
        if is_fisheye(lens) or not dropped(lens, form.coefficients):
            continue
        made = refit(lens, camera.image_size, form.coefficients)
        if made[2].max_px > max_loss_px and volume is not None:
            made = refit(lens, camera.image_size, form.coefficients, (camera, volume))
        found[camera.id] = made
    return found


def _file_rig(
    rig: Rig, first: str | None, unit: Unit, lenses: _Lenses, override: Override | None
) -> tuple[FileRig, dict[str, Loss]]:
    """The rig as files have it, and the lenses' losses; `first`: the reference camera of a rig in a user's frame."""
    cameras = []
    for camera in rig.cameras:
        lens, rotation, _ = lenses.get(camera.id, (camera.intrinsics, np.eye(3), None))
        pose = Pose(rotation @ camera.rotation, rotation @ camera.translation_mm / MM_PER[unit])
        cameras.append(FileCamera(camera.id, camera.image_size, lens, pose, camera.serial, camera.field))
    source = f"SphereCal {__version__}, input sha256 {rig.input_sha256[:16]}, scale from {rig.scale.source}"
    if rig.quality.verdict != "valid":
        concerned = f" for {named(rig.quality.affected)}" if rig.quality.valid else ""
        source = f"{source}, {WORDS[rig.quality.verdict]}{concerned}"
    if override is not None:
        source = f"{source}, {_FAILED}, used all the same by {override.by}: {override.reason}"
    return FileRig(tuple(cameras), rig.reference_camera, unit, source, first), {c: one[2] for c, one in lenses.items()}


def _write_scene(
    form: SceneFormat, rig: Rig, output: Path, unit: Unit | None, frame: UserFrame | None, override: Override | None
) -> Exported:
    """Write the rig as a scene and read its frusta back."""
    if unit not in (None, form.unit):
        raise InputError(Phrase("error-fixed-unit", {"format": form.title, "unit": form.unit}))
    placed, first = (rig, None) if frame is None else (in_frame(rig, frame), rig.reference_camera)
    file_rig, _ = _file_rig(placed, first, form.unit, {}, override)
    write_file_whole(output, form.write(file_rig).encode())
    difference = scene_difference_px(form, output, file_rig)
    return Exported(form, form.unit, [camera.id for camera in file_rig.cameras], difference, {})


def _refuse_losses(form: Format, losses: Mapping[str, Loss], rig: Rig, max_loss_px: float) -> None:
    if not losses or max(loss.max_px for loss in losses.values()) <= max_loss_px:
        return
    worst = max(losses, key=lambda name: losses[name].max_px)
    camera = next(c for c in rig.cameras if c.id == worst)
    names = list(dropped(camera.intrinsics, form.coefficients))
    needed = np.ceil(losses[worst].max_px * 100) / 100
    loss = losses[worst]
    values = {
        "format": form.title, "count": form.coefficients, "names": names, "camera": worst, "max_px": loss.max_px,
        "rms_px": loss.rms_px, "limit_px": max_loss_px, "needed_px": float(needed),
        "over": Phrase("over-image" if loss.image_px is None else "over-volume"),
    }  # fmt: skip
    raise InputError(Phrase("error-lens-lost", values))


def _write(form: Format, files: Mapping[str, bytes], output: Path, manifest: Mapping[str, object]) -> None:
    if not form.folder:
        write_file_whole(output, files[""])
        return

    def build(folder: Path) -> None:
        for name, data in files.items():
            write_new(folder, name, data)
        write_new(folder, EXPORT.file, json_bytes(manifest))

    write_folder_whole(output, build, EXPORT)


def _manifest(
    form: Format,
    files: Mapping[str, bytes],
    rig: FileRig,
    losses: Mapping[str, Loss],
    lost: Mapping[str, FieldLoss],
    verdict: Verdict,
) -> dict[str, object]:
    """export.json: by it the folder is known again as an export that may be replaced, and says what it holds."""
    return {
        "format": EXPORT.format,
        "version": 1,
        "export_format": form.name,
        "length_unit": rig.unit,
        "source": rig.source,
        "verdict": verdict,
        "cameras": dict(zip((camera.id for camera in rig.cameras), form.ids(rig), strict=True)),
        "files_sha256": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        "fields_lost": {name: {"max_px": one.max_px, "max_mm": one.max_mm} for name, one in lost.items()},
        "refit": {
            name: {"rms_px": one.rms_px, "max_px": one.max_px}
            | ({} if one.image_px is None else {"max_px_over_image": one.image_px})
            for name, one in losses.items()
        },
        "software": software_entry(None),
    }


def check_points(camera: RigCamera, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Up to 1,000 points (n, 3) mm and their images (n, 2), near and far, where the lens can be inverted."""
    random = np.random.default_rng(_SEED)
    width, height = camera.image_size
    uv = random.uniform((-0.5, -0.5), (width - 0.5, height - 0.5), (_CHECK_POINTS, 2))
    xy, good = undistort(uv, camera.intrinsics)
    centres = np.array([other.centre_mm for other in rig.cameras])
    spread = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()) or 1000.0
    depth = random.uniform(0.5, 2.0, good.sum()) * spread
    points = np.column_stack([xy[good], np.ones(good.sum())]) * depth[:, None]
    return (points - camera.translation_mm) @ camera.rotation, project(points, camera.intrinsics)


def largest_difference_px(
    rig: Rig, ids: Sequence[str], cameras: Sequence[FileCamera], unit: Unit, fields: bool = False
) -> float:
    """Largest difference in px of the rig's projections from those of cameras read; infinite where they have none."""
    by_id = {camera.id: camera for camera in cameras}
    largest = 0.0
    for camera, name in zip(rig.cameras, ids, strict=True):
        world, uv = check_points(camera, rig)
        if fields and camera.field is not None:
            uv = camera.field.measured(uv)
        difference = np.linalg.norm(by_id[name].project(world / MM_PER[unit]) - uv, axis=1)
        difference = difference[np.isfinite(difference)] if fields else difference
        largest = max(largest, float(difference.max()) if np.isfinite(difference).all() else np.inf)
    return largest
