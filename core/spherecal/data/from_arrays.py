"""A session from arrays in memory instead of a folder; the same checks as of files."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.arrays import FloatArray, IntArray, float_array
from spherecal.base.errors import InputError
from spherecal.base.file_reading import id_problem
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import LEAST_SIGMA_PX, MARGIN, SIGMA_COLUMNS, Observations, name_problem
from spherecal.data.rig_camera import ImageSize, is_wide, size_of
from spherecal.data.session import CameraSpec
from spherecal.geometry import opencv
from spherecal.targets.target_set import TargetSet

POINT = "centre"  # of points that come as rows of arrays
_FORMS = (
    "Give {camera: {frame: (ids, uv)}}, arrays (n, 2) or (frames, n, 2) by camera, or a table (dict of columns or data "
    "frame) with camera, target, u, v."
)

Lens = CameraSpec | ArrayLike | tuple[ArrayLike, ArrayLike | None]
Places = dict[str, dict[str, tuple[IntArray, FloatArray]]]  # by frame and camera, ids (n,) and image points (n, k, 2)


def of_kind(name: str, value: Any, kinds: type | tuple[type, ...], wanted: str) -> Any:
    """The value of an argument; InputError that says what is wanted where it is of another kind."""
    if not isinstance(value, kinds):
        raise InputError(f"{name} must be {wanted}, but is {_shown(value)}.")
    return value


def above_zero(name: str, value: Any) -> float:
    """The value of an argument that must be a number above 0."""
    if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool):
        raise InputError(f"{name} must be a number above 0, but is {_shown(value)}.")
    if not 0 < value < np.inf:
        raise InputError(Phrase("error-above-zero", {"name": name, "value": value}))
    return float(value)


def _shown(value: Any) -> str:
    text = repr(value)
    if len(text) <= 60 and "\n" not in text:
        return text
    return f"an array {value.shape}" if isinstance(value, np.ndarray) else f"a value of type {type(value).__name__}"


def lenses_by_camera(cameras: Any, observations: Any) -> Mapping[str, Lens]:
    """The lenses by camera; one K or (K, dist) is that of every camera that the observations name."""
    if isinstance(cameras, Mapping):
        return {str(name): lens for name, lens in cameras.items()}
    pair = isinstance(cameras, tuple | list) and len(cameras) == 2
    shape = np.shape(cameras[0] if pair else cameras) if not isinstance(cameras, str | CameraSpec) else ()
    if shape != (3, 3):
        wanted = "{camera: K}, {camera: (K, dist)} or one K (3, 3) or (K, dist) for all cameras"
        raise InputError(f"cameras must be {wanted}, but is {_shown(cameras)}.")
    keys = list(observations.keys()) if hasattr(observations, "keys") else []
    if _is_table(observations, keys):
        return dict.fromkeys(map(str, _table(observations, keys)["camera"]), cameras)
    if not keys:
        raise InputError(f"observations are {_shown(observations)}, which names no cameras.", _FORMS)
    if any(hasattr(observations[key], "keys") for key in keys):  # the outer names may be those of frames
        raise InputError(
            "One K for all cameras does not say which names of observations are cameras, and which are frames.",
            "Give cameras={name: K for name in observations} if its outer names are the cameras.",
        )
    return dict.fromkeys(map(str, keys), cameras)


def camera_specs(
    cameras: Mapping[str, Lens], image_size: ImageSize | None, fisheye: bool | Collection[str]
) -> tuple[CameraSpec, ...]:
    """The cameras of a session: descriptions as they are, K or (K, dist) with the size of the images.

    `image_size` (width, height) in px for all, or by camera; None: only for cameras that are CameraSpec.
    """
    if not cameras:
        raise InputError("A session needs at least one camera.")
    return tuple(_camera(name, given, image_size, fisheye) for name, given in cameras.items())


def _camera(name: str, given: Any, image_size: ImageSize | None, fisheye: bool | Collection[str]) -> CameraSpec:
    what = f'camera "{name}"'
    if problem := id_problem(name):
        raise InputError(f"The camera's id {name!r} {problem}.")
    if isinstance(given, CameraSpec):
        if given.id != name:
            raise InputError(f'The entry of {what} describes camera "{given.id}".')
        return given
    if image_size is None:
        raise InputError(f"The image size of {what} is not given.", "Give image_size=(width, height).")
    if isinstance(given, str | Mapping):
        raise InputError(f"The lens of {what} must be K (3, 3), (K, dist) or a CameraSpec, but is {_shown(given)}.")
    pair = isinstance(given, tuple | list) and len(given) == 2
    K, dist = given if pair else (given, None)
    wide, size = is_wide(name, fisheye), size_of(name, image_size)
    lens = opencv.lens_vector(K, dist, wide, what)
    return CameraSpec(name, size, lens, True, name, lens_model="fisheye" if wide else "brown")


def observations_of(given: Any, cameras: Sequence[CameraSpec], bar_poses: Sequence[str]) -> Observations:
    """Observations from a table of columns, from arrays by camera, or from those by placement (`Session.from_arrays`).

    The names of placements come first, then those of `bar_poses`. Image points that are not finite are left out.
    """
    columns = _columns(given, [camera.id for camera in cameras])
    uv = np.column_stack([_numbers(columns[name], name) for name in ("u", "v")]).reshape(-1, 2)
    n = len(uv)
    for name, values in columns.items():
        if len(values) != n:
            raise InputError(f"The column {name} has {len(values)} values, u and v have {n}.")
    seen = np.asarray(np.isfinite(uv).all(axis=1))
    placements = [str(p) for p in dict.fromkeys(columns["placement"]) if str(p) not in bar_poses]
    for place in (*placements, *bar_poses):
        if problem := id_problem(place):
            raise InputError(f"The placement's id {place!r} {problem}.")
    points = sorted({str(name) for name in columns["point"]})
    for point in points:
        if problem := name_problem(point):
            raise InputError(f"The point's name {point!r} {problem}.")
    ids = tuple(camera.id for camera in cameras)
    sigma = None
    if SIGMA_COLUMNS[0] in columns:
        sigma = np.column_stack([_numbers(columns[name], name) for name in SIGMA_COLUMNS])
        if not (sigma[seen] >= LEAST_SIGMA_PX).all():
            raise InputError(f"sigma_u and sigma_v must be {LEAST_SIGMA_PX:g} px or more.")
    places = (*placements, *bar_poses)
    named = (("placement", places), ("camera", ids), ("point", tuple(points)))
    placement, camera, point = (_index(columns[name], known, name) for name, known in named)
    rows = placement, camera, _whole_numbers(columns["target"]), point, uv, sigma
    observations = Observations(places, ids, tuple(points), *rows).select(seen)
    _check_inside(observations, cameras)
    _check_once(observations)
    return observations


def digest(cameras: Sequence[CameraSpec], observations: Observations, target_set: TargetSet | None, rest: str) -> str:
    """The SHA-256 of what a session from arrays was made of."""
    o = observations
    sha = hashlib.sha256(repr((o.placements, o.cameras, o.points)).encode())
    for values in (o.placement, o.camera, o.target, o.point, o.uv, *(() if o.sigma is None else (o.sigma,))):
        sha.update(values.tobytes())
    for camera in cameras:
        lens = f"{camera.intrinsics_group} {camera.lens_model} {camera.prior.tolist()}"
        sha.update(f"{camera.id} {camera.image_size} {lens}".encode())
    if target_set is not None:
        t = target_set
        sha.update(f"{t.family} {t.polarity} {t.size_mm} {t.dot_diameter_mm} {t.dictionary}".encode())
        for target, dots in target_set.layouts.items():
            sha.update(repr((target, {name: place.tolist() for name, place in dots.items()})).encode())
    sha.update(rest.encode())
    return sha.hexdigest()


def _columns(given: Any, cameras: Sequence[str]) -> Mapping[str, Sequence[Any]]:
    """The table's columns, or those of arrays written out as one."""
    if isinstance(given, Observations):
        raise InputError("Observations must be a table of columns or arrays by camera.", _FORMS)
    keys = list(given.keys()) if hasattr(given, "keys") else []
    if _is_table(given, keys):
        return _table(given, keys)
    if not keys:
        try:
            stack = np.zeros(()) if isinstance(given, Mapping) else float_array(given, "observations")
        except InputError as error:
            raise InputError(error.message, _FORMS) from None
        if not stack.ndim:
            raise InputError(f"observations are {_shown(given)}, which holds no image points.", _FORMS)
        return _written_out({"P1": stack}, cameras)
    by_name = {str(key): given[key] for key in keys if given[key] is not None}
    if (places := _with_ids(by_name, cameras)) is not None:
        return _rows(places)
    if any(key in cameras for key in by_name):
        return _frames(by_name, cameras)
    return _written_out(by_name, cameras)


def _with_ids(given: Mapping[str, Any], cameras: Sequence[str]) -> Places | None:
    """Image points that come with their ids: by camera, by camera and frame, or by frame and camera; None for others.

    What one camera sees in one frame is (ids, uv) or {id: (u, v)}.
    """
    by_camera = any(key in cameras for key in given)
    inner: dict[str, Mapping[str, Any]] = {}
    for outer, one in given.items():
        if by_camera and ids_and_points(one) is not None:
            inner[outer] = {"P1": one}
        elif hasattr(one, "keys"):
            inner[outer] = {str(key): one[key] for key in one}
        else:
            return None
    found: Places = {}
    for outer, items in inner.items():
        for key, one in items.items():
            pair = ids_and_points(one)
            if pair is None:
                if not by_camera and not found:  # arrays by placement
                    return None
                given_there = f"The image points of {outer}, {key}"
                raise InputError(f"{given_there} must be (ids, uv) or {{id: (u, v)}}, but are {_wrong(one)}.", _FORMS)
            frame, camera = (key, outer) if by_camera else (outer, key)
            if camera not in cameras:
                raise InputError(f'"{camera}" is not in cameras.', f"It has {', '.join(cameras)}.")
            if len(pair[0]) != len(pair[1]):
                raise InputError(f"{camera}, {frame}: {len(pair[0])} ids, but {len(pair[1])} image points.")
            found.setdefault(frame, {})[camera] = pair
    numbers = all(frame.isdecimal() for frame in found)  # frames that one camera missed come late in the others' order
    return {frame: found[frame] for frame in (sorted(found, key=int) if numbers else found)}


def ids_and_points(one: Any) -> tuple[IntArray, FloatArray] | None:
    """Ids (n,) and image points (n, k, 2) of (ids, uv) or {id: (u, v)}, in OpenCV's shapes too; None for others."""
    if one is None:
        ids, uv = None, None
    elif hasattr(one, "keys"):
        seen = [(key, place) for key, place in one.items() if place is not None]
        ids, uv = [key for key, _ in seen], [place for _, place in seen]
    elif isinstance(one, tuple | list) and len(one) == 2:
        ids, uv = one
    else:
        return None
    if ids is None or (np.size(ids) == 0 and np.size(uv if uv is not None else ()) == 0):  # as cv2.aruco finds none
        return np.zeros(0, dtype=np.int64), np.zeros((0, 1, 2))
    try:
        numbers, points = np.asarray(ids, dtype=float), np.asarray(uv, dtype=float)
    except (TypeError, ValueError):
        return None
    column = numbers.ndim == 1 or (numbers.ndim == 2 and numbers.shape[1] == 1)
    dimensions = (2,) if hasattr(one, "keys") else (2, 3, 4)
    if not column or points.ndim not in dimensions or points.shape[-1] != 2:
        return None
    return _whole_numbers(numbers.ravel().tolist()), points.reshape(len(points), -1, 2)


def _wrong(one: Any) -> str:
    """What is not (ids, uv) or {id: (u, v)}, for a message: the first wrong item of a dict, the shapes of a pair."""
    if hasattr(one, "keys"):
        items = list(one.items())
        key, place = next((item for item in items if ids_and_points(dict([item])) is None), items[0])
        return f"{{{key!r}: {_shown(place)}, ...}}"
    if isinstance(one, tuple | list) and len(one) == 2:
        return f"({_shown(one[0])}, {_shown(one[1])})"
    return _shown(one)


def _is_table(given: Any, keys: Sequence[str]) -> bool:
    """Whether observations are columns: by their names, or as a data frame."""
    return bool(keys) and ({"u", "v"} <= set(keys) or {"camera", "target"} <= set(keys) or hasattr(given, "columns"))


def _rows(places: Places) -> Mapping[str, Sequence[Any]]:
    """A row for each point; those with more than one image point, as the corners of a marker, are named 0, 1, ..."""
    columns: dict[str, list[Any]] = {name: [] for name in ("placement", "camera", "target", "point", "u", "v")}
    for place, by_camera in places.items():
        for camera, (ids, points) in by_camera.items():
            n, k = points.shape[:2]
            columns["placement"] += [place] * (n * k)
            columns["camera"] += [camera] * (n * k)
            columns["target"] += np.repeat(ids, k).tolist()
            columns["point"] += ([POINT] if k == 1 else [str(i) for i in range(k)]) * n
            columns["u"] += points[:, :, 0].ravel().tolist()
            columns["v"] += points[:, :, 1].ravel().tolist()
    return columns


def _table(given: Any, keys: Sequence[str]) -> Mapping[str, Sequence[Any]]:
    if missing := [name for name in ("camera", "target", "u", "v") if name not in keys]:
        raise InputError(f"The table of observations has no column {' and no column '.join(missing)}.", _FORMS)
    if len(set(SIGMA_COLUMNS) & set(keys)) == 1:
        raise InputError("The table of observations has only one of the columns sigma_u and sigma_v.", "Give both.")
    n = len(given["u"])
    frames = list(given["frame"]) if "frame" in keys else ["P1"] * n
    columns: dict[str, Any] = {"placement": frames, "point": [POINT] * n}
    wanted = ("placement", "camera", "target", "point", "u", "v")
    columns |= {name: list(given[name]) for name in wanted if name in keys}
    if set(SIGMA_COLUMNS) <= set(keys):
        columns |= {name: list(given[name]) for name in SIGMA_COLUMNS}
    return columns


def _frames(given: Mapping[str, ArrayLike], cameras: Sequence[str]) -> Mapping[str, Sequence[Any]]:
    """Arrays (n, 2) of each camera, or (t, n, 2) for t placements P1, P2, ..."""
    arrays = _arrays(given, cameras)
    if all(array.ndim == 2 for array in arrays.values()):
        return _written_out({"P1": arrays}, cameras)
    shapes = {array.shape for array in arrays.values()}
    if len(shapes) > 1:
        raise InputError(
            f"The cameras' arrays have different shapes: {', '.join(map(str, sorted(shapes)))}.",
            "Give (n, 2) or (placements, n, 2); put NaN where a camera does not see a point.",
        )
    count = next(iter(shapes))[0]
    return _written_out({f"P{t + 1}": {name: a[t] for name, a in arrays.items()} for t in range(count)}, cameras)


def _written_out(places: Mapping[str, Any], cameras: Sequence[str]) -> Mapping[str, Sequence[Any]]:
    """A row for each point of each array; its row number is its target."""
    rows: Places = {}
    for place, given in places.items():
        arrays = _by_camera(place, given, cameras)
        counts = sorted({len(array) for array in arrays.values()})
        if len(counts) > 1:
            raise InputError(
                f"The cameras have different numbers of image points at {place} ({', '.join(map(str, counts))}).",
                "Row i of every camera is the same point; put NaN where a camera does not see it.",
            )
        rows[place] = {name: (np.arange(len(array)), array[:, None]) for name, array in arrays.items()}
    return _rows(rows)


def _by_camera(place: str, given: Any, cameras: Sequence[str]) -> dict[str, FloatArray]:
    """Arrays (n, 2) by camera, in the cameras' order."""
    if not hasattr(given, "keys"):
        stack = float_array(given, f"The image points of {place}")
        if stack.ndim == 2 and place != "P1":
            raise InputError(f'"{place}" is neither a camera nor a column.', f"Cameras: {', '.join(cameras)}. {_FORMS}")
        if stack.ndim != 3 or len(stack) != len(cameras):
            raise InputError(
                f"The image points of {place} must be an array ({len(cameras)}, n, 2), one part for each camera, "
                f"but have the shape {stack.shape}."
            )
        given = dict(zip(cameras, stack, strict=True))
    arrays = _arrays(given, cameras)
    for name, array in arrays.items():
        if array.ndim != 2:
            raise InputError(f"The image points of {name} at {place} must be (n, 2), but are {array.shape}.")
    return arrays


def _arrays(given: Mapping[str, ArrayLike], cameras: Sequence[str]) -> dict[str, FloatArray]:
    """The image points of each camera, in the cameras' order."""
    if unknown := [str(name) for name in given if name not in cameras]:
        raise InputError(f'"{unknown[0]}" is neither a camera nor a column.', f"Cameras: {', '.join(cameras)}.")
    arrays: dict[str, FloatArray] = {}
    for name in (name for name in cameras if name in given):
        array = arrays[name] = float_array(given[name], f"The image points of {name}")
        if array.ndim not in (2, 3) or array.shape[-1] != 2:
            raise InputError(f"The image points of {name} must be (n, 2) or (placements, n, 2), but are {array.shape}.")
    return arrays


def _numbers(values: Sequence[Any], name: str) -> FloatArray:
    try:
        return np.asarray(values, dtype=float).reshape(len(values))
    except (TypeError, ValueError):
        if len(values) > 1:  # which one it is
            for value in values:
                _numbers([value], name)
        raise InputError(f"The column {name} has {_shown(values[0])}, which is not a number.") from None


def _whole_numbers(values: Sequence[Any]) -> IntArray:
    numbers = _numbers(values, "target")
    whole = np.isfinite(numbers) & (numbers == np.floor(numbers)) & (np.abs(numbers) < 2**53)
    if not whole.all():
        raise InputError(f"The column target has {numbers[~whole][0]:g}, which is not a whole number.")
    return numbers.astype(np.int64)


def _index(values: Sequence[Any], names: Sequence[str], column: str) -> IntArray:
    index = {name: i for i, name in enumerate(names)}
    found = np.array([index.get(str(value), -1) for value in values], dtype=np.int64)
    if (found < 0).any():
        wrong = str(values[int(np.argmax(found < 0))])
        raise InputError(f'The column {column} names "{wrong}", which is not known.', f"Known: {', '.join(names)}.")
    return found


def _check_inside(o: Observations, cameras: Sequence[CameraSpec]) -> None:
    size = np.array([camera.image_size for camera in cameras], dtype=float).reshape(-1, 2)[o.camera]
    margin = MARGIN * size.max(axis=1, initial=0.0)[:, None]
    outside = ((o.uv < -margin) | (o.uv > size - 1 + margin)).any(axis=1)
    if outside.any():
        i = int(np.argmax(outside))
        raise InputError(
            f"Camera {o.cameras[o.camera[i]]}, {o.placements[o.placement[i]]}, target {o.target[i]}: the image point "
            f"({o.uv[i, 0]:g}, {o.uv[i, 1]:g}) is outside the image of {size[i, 0]:.0f} x {size[i, 1]:.0f} pixels.",
            "Is image_size (width, height), and are the points (u, v)?",
        )


def _check_once(o: Observations) -> None:
    rows = np.stack([o.placement, o.target, o.point, o.camera], axis=1)
    unique, count = np.unique(rows, axis=0, return_counts=True)
    if (count > 1).any():
        placement, target, point, camera = unique[int(np.argmax(count > 1))]
        raise InputError(
            f"Camera {o.cameras[camera]} has {o.points[point]} of target {target} twice at {o.placements[placement]}.",
            "Each camera sees a point once in a placement.",
        )
