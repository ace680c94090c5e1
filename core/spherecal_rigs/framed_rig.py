"""The user's frame: its file, a rig in it, and its definition by places of a result."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import BallShape, CameraCovariance, CameraSigma, Rig, RigCamera
from spherecal.geometry.length_uncertainty import LengthMap
from spherecal.geometry.sphere import fit_sphere
from spherecal.geometry.transform import fit_similarity
from spherecal_files import codec
from spherecal_files.atomic import write_file_whole
from spherecal_files.ball_file import BALL_FILE, LEAST_DOTS, read_ball
from spherecal_files.json_file import printable, read_json
from spherecal_files.rig_file import read_rig, rotation
from spherecal_files.table_file import Table
from spherecal_files.verification_file import VERIFICATION
from spherecal_files.write_result import POINT_COLUMNS, SPHERE_COLUMNS
from spherecal_rigs.result_folder import read_csv
from spherecal_rigs.user_frame import TURNS, FrameDefinition, UserFrame, user_frame

_DEFINITION = codec.record(
    "How it was defined; `origin`, `x` and `xy` are all given or none.",
    FrameDefinition,
    codec.optional("origin", codec.text("The place of the origin.")),
    codec.optional("x", codec.text("A place on the x axis.")),
    codec.optional("xy", codec.text("A place in the xy plane.")),
    codec.optional("offset_mm", codec.numbers("Shift of the origin.", 3)),
    codec.optional("turns", codec.items("Turns by 90 degrees.", codec.choice("", TURNS))),
).that(lambda made: (made.origin, made.x, made.xy).count(None) in (0, 3), Phrase("problem-three-places"))
_SIGMAS = codec.items("", codec.number("", 0), length=3).mapped(np.array)
FIELDS = (
    codec.field("rotation", rotation("x_user = R x_world + t.")),
    codec.field("translation_mm", codec.numbers("The same.", 3).mapped(np.array)),
    codec.field("definition", _DEFINITION),
    codec.optional("reference_camera", codec.name("The reference camera of the calibration.")),
    codec.optional("input_sha256", codec.text("`input_sha256` of the calibration.")),
    codec.optional("distance_mm", codec.number("Distance from the origin to the place on the x axis.", 0)),
    codec.optional("angle_deg", codec.number("Between the two places, seen from the origin.", 0, 180, "°")),
    codec.optional("origin_sigma_mm", _SIGMAS.described("Standard uncertainties of the origin.")),
    codec.optional("axes_sigma_deg", _SIGMAS.described("Standard uncertainties of the axes.")),
)
FRAME = codec.FileFormat(
    "spherecal/frame",
    "frame.json",
    "The user's frame.",
    codec.record("", UserFrame, *FIELDS, codec.software()),
    ("The rotation is orthogonal within 1e-5.",),
    more="exports.md#the-users-frame",
)


def write_frame(frame: UserFrame, path: Path) -> None:
    """Write the file whole."""
    write_file_whole(path, FRAME.bytes(frame))


def frame_entry(frame: UserFrame) -> dict[str, Any]:
    """A frame as files have it."""
    return codec.record("", UserFrame, *FIELDS).entry(frame)


_AXES = ("x_mm", "y_mm", "z_mm")
_MOST_NAMED = 12


@dataclass(frozen=True)
class Place:
    """A place (3,) mm with covariance (3, 3) mm^2, NaN if not known: a ball's centre, a bar's mark or a point."""

    name: str
    kind: str
    place_mm: FloatArray
    covariance_mm2: FloatArray


def result_places(folder: Path, requested: Collection[str] = ()) -> dict[str, Place]:
    """The places of a result by name: P1 (ball centre), A-01/A1 (mark of a verified bar), B-01/901/centre (a point)."""
    table = read_csv(folder / "points.csv", POINT_COLUMNS)
    xyz = np.column_stack([table.numbers(axis) for axis in _AXES]).reshape(-1, 3)
    sigma = np.column_stack([table.lengths(f"sigma_{axis}", may_be_empty=True) for axis in _AXES]).reshape(-1, 3)
    keys = list(
        zip(table.names("placement"), table.whole_numbers("target").tolist(), table.names("point"), strict=True)
    )
    found = _spheres(read_csv(folder / "spheres.csv", SPHERE_COLUMNS))
    if (folder / BALL_FILE).is_file():
        found |= _rigid_balls(read_ball(folder).shape, found, keys, xyz, sigma)
    found |= _marks(folder / "verification.json")
    asked = {name for name in requested if "/" in name}
    for row, (placement, target, point) in enumerate(keys):
        if placement in found and not asked:
            continue
        name = f"{placement}/{target}/{point}"
        if placement not in found or name in asked:
            found[name] = Place(name, "point", xyz[row], np.diag(sigma[row] ** 2))
    return found


def _spheres(table: Table) -> dict[str, Place]:
    """The centres of the fitted spheres, with the radial sd as each coordinate's standard uncertainty.

    A ball out of round moves its sphere's centre with the side that is seen, which many dots do not average out: 0.24
    mm rms a coordinate at a radial sd of 0.36 mm (45 placements on rig A, simulated).
    """
    centres = np.column_stack([table.numbers(axis) for axis in _AXES]).reshape(-1, 3)
    sds = table.lengths("radial_sd_mm", may_be_empty=True)
    names = table.names("placement")
    return {n: Place(n, "ball", c, np.eye(3) * sd**2) for n, c, sd in zip(names, centres, sds, strict=True)}


def _rigid_balls(
    shape: BallShape,
    balls: Mapping[str, Place],
    keys: Sequence[tuple[str, int, str]],
    xyz: FloatArray,
    sigma: FloatArray,
) -> dict[str, Place]:
    """The centre of a rigid ball's whole shape, laid over the dots of every placement, as sure as one dot.

    The dots of a placement err together, with the ball's pose. Measured as for fitted spheres: 0.0016 mm rms per
    coordinate, a third of what is stated.
    """
    whole = fit_sphere(shape.places_mm)
    at = {key: i for i, key in enumerate(zip(shape.target.tolist(), shape.point, strict=True))}
    rows_of: dict[str, list[int]] = {name: [] for name in balls}
    for i, (placement, *dot) in enumerate(keys):
        if placement in rows_of and tuple(dot) in at:
            rows_of[placement].append(i)
    found = {}
    for name, rows in rows_of.items():
        if whole is None or len(rows) < LEAST_DOTS:
            continue
        laid = fit_similarity(shape.places_mm[[at[keys[i][1:]] for i in rows]], xyz[rows], with_scale=False)
        covariance = np.diag((sigma[rows] ** 2).mean(axis=0))
        found[name] = Place(name, "ball", laid.apply(whole.centre[None])[0], covariance)
    return found


def _marks(path: Path) -> dict[str, Place]:
    """The ends of the longest length of every bar pose that was verified; none where nothing was."""
    if not path.is_file():
        return {}
    f = read_json(path, VERIFICATION.name, VERIFICATION.version).fields((), ("procedure",))
    poses = f["procedure"].fields((), ("poses",)).get("poses") if "procedure" in f else None
    found = {}
    for pose in poses.items() if poses is not None else ():
        p = pose.fields(("id", "from", "to"), ("ends_mm",))
        if "ends_mm" in p:
            for mark, end in zip(("from", "to"), p["ends_mm"].matrix(2, 3), strict=True):
                name = f"{p['id'].name()}/{p[mark].name()}"
                found[name] = Place(name, "mark", np.array(end), np.full((3, 3), np.nan))
    return found


def define_frame(folder: Path, definition: FrameDefinition) -> UserFrame:
    """The user's frame in the world of the rig in a result folder."""
    rig = read_rig(folder / "rig.json")
    places = result_places(folder, definition.places) if definition.places else {}
    return frame_of(definition, places, rig)


def frame_of(definition: FrameDefinition, places: Mapping[str, Place], rig: Rig) -> UserFrame:
    """The frame that a definition gives with these places of a rig."""
    for name in definition.places:
        if name not in places:
            raise InputError(Phrase("error-no-place", {"name": printable(name)}), _places_there(places))
    named = [places[name] for name in definition.places]
    at, covariances = np.array([p.place_mm for p in named]), np.array([p.covariance_mm2 for p in named])
    frame = user_frame(definition, at, covariances, "mm" if rig.scale.source != "none" else "units")
    return replace(frame, reference_camera=rig.reference_camera, input_sha256=rig.input_sha256)


def _places_there(places: Mapping[str, Place]) -> str:
    named = [name for name, place in places.items() if place.kind != "point"]
    if len(places) < 3:
        return "It has fewer than three places: only the reference camera's frame can be turned."
    more = ", ..." if len(named) > _MOST_NAMED else ""
    return (
        f"Ball centres and bar marks: {', '.join(named[:_MOST_NAMED]) or 'none'}{more}; any other point of points.csv "
        f"is PLACEMENT/TARGET/POINT."
    )


def in_frame(rig: Rig, frame: UserFrame) -> Rig:
    """The rig with the user's frame for its world: centres' sigmas are turned, those about the cameras stay."""
    if frame.reference_camera != rig.reference_camera:
        names = {"camera": frame.reference_camera or "-", "own": rig.reference_camera or "-"}
        raise InputError(Phrase("error-other-reference", names))
    cameras = tuple(
        _camera(camera, frame, _correlation(camera, i, rig.covariance)) for i, camera in enumerate(rig.cameras)
    )
    earlier = tuple(_camera(camera, frame, np.eye(3)) for camera in rig.earlier_poses)
    repairs = tuple(
        repair
        if repair.earlier_pose is None
        else replace(repair, earlier_pose=_camera(repair.earlier_pose, frame, np.eye(3)))
        for repair in rig.repairs
    )
    return replace(
        rig, reference_camera=None, cameras=cameras, earlier_poses=earlier, repairs=repairs,
        length_map=_map(rig.length_map, frame),
    )  # fmt: skip


def _camera(camera: RigCamera, frame: UserFrame, correlation: FloatArray) -> RigCamera:
    rotation = camera.rotation @ frame.rotation.T
    sigma = camera.sigma
    if sigma is not None:
        covariance = frame.rotation @ (correlation * np.outer(sigma.centre_mm, sigma.centre_mm)) @ frame.rotation.T
        turned = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        sigma = CameraSigma(sigma.rotation_deg, turned, sigma.intrinsics)
    translation = camera.translation_mm - rotation @ frame.translation_mm
    return replace(camera, rotation=rotation, translation_mm=translation, sigma=sigma)


def _correlation(camera: RigCamera, index: int, covariance: CameraCovariance | None) -> FloatArray:
    """The correlations (3, 3) of a camera's centre in the world: C' = C - R' d (docs/conventions.md)."""
    if covariance is None:
        return np.eye(3)
    first = index * (6 + len(covariance.intrinsics)) + 3
    shift = covariance.matrix[first : first + 3, first : first + 3]
    own = camera.rotation.T @ shift @ camera.rotation
    size = np.sqrt(np.diag(own))
    return own / np.outer(size, size) if (size > 0).all() else np.eye(3)


def _map(found: LengthMap | None, frame: UserFrame) -> LengthMap | None:
    if found is None:
        return None
    return replace(found, places_mm=frame.apply(found.places_mm), directions=found.directions @ frame.rotation.T)
