"""Repairs of a session: images left out, exchanged images put back, a second pose for a camera that moved.

They work on the session, before anything is computed, and are recorded in the result. A user asks for them, or findings
that are certain do (steps/automatic_repairs.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.data.rig import Calibration, Repair, Rig, RigCamera
from spherecal.data.session import BarPose, Placement, Scale, Session
from spherecal.data.verdict import with_findings
from spherecal.geometry.rotation import log_rotation

# Sources of scale that can be struck out by hand.
SCALE_SOURCES = {
    "scale:bar": Phrase("source-bar"),
    "scale:print": Phrase("source-print"),
    "scale:ball": Phrase("source-ball"),
}


@dataclass(frozen=True)
class Repairs:
    """What is asked for, as on the command line.

    `leave_out`: `camera:C05`, `placement:P3`, `C05@P3` or a source of scale (`scale:bar`); `split`: `C05@P3` (another
    pose from there on); `swap`: `C05,C06` or `C05,C06@P3` (exchange their images). Placements are bar poses too.
    """

    leave_out: tuple[str, ...] = ()
    split: tuple[str, ...] = ()
    swap: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.leave_out or self.split or self.swap)


def repaired(session: Session, repairs: Repairs) -> Session:
    """The session with exchanged images put back, then some left out, then cameras split.

    A camera that is split becomes two, with one set of intrinsics. It keeps its pose from the placement on; another
    one, with `earlier_pose_of`, has the pose before. What is before is by the order of placements, then bar poses.
    """
    for value in repairs.swap:
        session = _swapped(session, *_read_swap(session, value))
    for value in repairs.leave_out:
        session = _left_out(session, value)
    at = [_read_image(session, value, "--split") for value in repairs.split]
    for camera, placement in sorted(at, key=lambda pair: pair[1]):
        session = _split(session, camera, placement)
    if len(session.cameras) < 2:
        raise InputError(Phrase("error-few-cameras-left"))
    return session


def recorded(
    calibration: Calibration, session: Session, mended: Session, repairs: Repairs, automatic: bool = False
) -> Calibration:
    """The calibration of a mended session, in terms of the original cameras, its repairs added, a finding for each."""
    rig, earlier = calibration.rig, {camera.id: camera for camera in calibration.rig.earlier_poses}
    done, findings = [], []

    why = Phrase("as-certain") if automatic else Phrase("as-asked")

    for value in repairs.swap:
        a, b, placement = _read_swap(session, value)
        names = [session.cameras[c].id for c in (a, b)]
        at = _places(session)[placement].id if placement is not None else None
        done.append(Repair("--swap", value, automatic=automatic))
        both = {"first": names[0], "second": names[1]}
        what = Phrase("exchanged-at", {**both, "place": at}) if at else Phrase("exchanged", both)
        where = (*names, *([at] if at else []))
        findings.append(Finding("swapped-back", "info", {"done": what, "why": why}, where))
    for value in repairs.leave_out:
        done.append(Repair("--leave-out", value, automatic=automatic))
        name, place = _names(session, *_read_out(session, value))
        where = tuple(one for one in (name, place) if one is not None)
        findings.append(Finding("left-out", "info", {"done": _what(value, name, place), "why": why}, where))
    for value in repairs.split:
        camera, placement = _read_image(session, value, "--split")
        name, place = session.cameras[camera].id, _places(session)[placement].id
        before = earlier.get(_name_before(name, place))
        done.append(Repair("--split", value, None if before is None else replace(before, id=name), automatic))
        what = {"done": _split_by(rig, name, place, before), "why": why}
        findings.append(Finding("pose-split", "info", what, (name, place)))
    others = {camera.id for camera in session.cameras if camera.earlier_pose_of is not None}
    left = tuple(camera for camera in rig.earlier_poses if camera.id in others)
    rig = replace(rig, repairs=(*done, *rig.repairs), earlier_poses=left)
    o = _under_old_names(calibration.observations, session, mended)
    return with_findings(replace(calibration, rig=rig, observations=o), tuple(findings))


def placements_seen_by(session: Session, cameras: Sequence[str]) -> list[str]:
    """The placements of the ball of which some cameras have observations, in order; all of a session without any."""
    o, names = session.observations, [placement.id for placement in session.placements]
    if o is None:
        return names
    own = np.isin(o.camera, [o.cameras.index(name) for name in cameras if name in o.cameras])
    return [names[t] for t in np.unique(o.placement[own & (o.placement < len(names))])]


def _split_by(rig: Rig, name: str, place: str, before: RigCamera | None) -> Phrase:
    """That a camera was split, and by how much it moved where that is known."""
    values = {"camera": name, "place": place}
    now = rig.camera(name)
    if now is None or before is None:
        return Phrase("split", values)
    shift = float(np.linalg.norm(now.centre_mm - before.centre_mm))
    turn = float(np.linalg.norm(log_rotation(now.rotation @ before.rotation.T)))
    key = "split-by" if rig.scale.source != "none" else "split-by-no-scale"
    return Phrase(key, {**values, "shift": shift, "degrees": np.rad2deg(turn)})


def _places(session: Session) -> tuple[Placement | BarPose, ...]:
    return (*session.placements, *session.bar_poses)


def _find(ids: list[str], name: str, kind: Phrase, value: str) -> int:
    if name in ids:
        return ids.index(name)
    values = {"kind": kind, "name": repr(name), "value": repr(value), "names": ids}
    raise InputError(Phrase("error-no-such-id", values))


def _camera_index(session: Session, name: str, value: str) -> int:
    return _find([camera.id for camera in session.cameras], name, Phrase("the-camera"), value)


def _place_index(session: Session, name: str, value: str) -> int:
    return _find([place.id for place in _places(session)], name, Phrase("the-placement"), value)


def _read_image(session: Session, value: str, option: str) -> tuple[int, int]:
    """Camera and placement (indices) of `C05@P3`; names may hold an @ themselves."""
    cuts = [i for i, letter in enumerate(value) if letter == "@"]
    if not cuts:
        raise InputError(Phrase("error-no-image-named", {"option": option, "value": repr(value)}))
    cameras = {camera.id for camera in session.cameras}
    cut = next((i for i in cuts if value[:i] in cameras), cuts[0])
    return _camera_index(session, value[:cut], value), _place_index(session, value[cut + 1 :], value)


def _read_swap(session: Session, value: str) -> tuple[int, int, int | None]:
    """Two cameras and a placement or None (all) of `C05,C06@P3`; names hold no comma."""
    first, comma, second = value.partition(",")
    if not comma:
        raise InputError(Phrase("error-swap-two", {"value": repr(value)}))
    a, placement = _camera_index(session, first.strip(), value), None
    second = second.strip()
    if "@" in second and second not in {camera.id for camera in session.cameras}:
        b, placement = _read_image(session, second, "--swap")
    else:
        b = _camera_index(session, second, value)
    if a == b:
        raise InputError(Phrase("error-swap-same", {"value": repr(value)}))
    return a, b, placement


def _what(value: str, name: str | None, place: str | None) -> Phrase:
    if name is not None and place is not None:
        return Phrase("image-out", {"camera": name, "place": place})
    if name is not None:
        return Phrase("camera-out", {"camera": name})
    if place is not None:
        return Phrase("placement-out", {"place": place})
    return Phrase("scale-source-out", {"source": SCALE_SOURCES[value]})


def _read_out(session: Session, value: str) -> tuple[int | None, int | None]:
    """Camera and placement (indices) that a --leave-out names, None for all; both None for a source of scale."""
    if value in SCALE_SOURCES:
        return None, None
    kind, colon, name = value.partition(":")
    if colon and kind == "camera":
        return _camera_index(session, name, value), None
    if colon and kind == "placement":
        return None, _place_index(session, name, value)
    if "@" not in value:
        raise InputError(Phrase("error-leave-out", {"value": repr(value)}))
    return _read_image(session, value, "--leave-out")


def _names(session: Session, camera: int | None, placement: int | None) -> tuple[str | None, str | None]:
    name = None if camera is None else session.cameras[camera].id
    return name, None if placement is None else _places(session)[placement].id


def _left_out(session: Session, value: str) -> Session:
    camera, placement = _read_out(session, value)
    if camera is None and placement is None:
        return _without_source(session, value.partition(":")[2])
    name, _ = _names(session, camera, placement)

    def without(t: int, images: _Images) -> _Images:
        return {c: p for c, p in images.items() if placement not in (None, t) or name not in (None, c)}

    there, o = _with_images(session, without), session.observations
    if o is not None:
        of_camera, of_place = (o.camera == camera, o.placement == placement)
        out = of_camera if placement is None else of_place if camera is None else of_camera & of_place
        there = replace(there, observations=o.select(~out))
    return there if placement is not None else _without_camera(there, camera)


def _without_camera(session: Session, camera: int | None) -> Session:
    """The session without a camera that has no observations any more."""
    keep, o = [c for c in range(len(session.cameras)) if c != camera], session.observations
    number = np.full(len(session.cameras), -1)
    number[keep] = np.arange(len(keep))
    o = None if o is None else replace(o, cameras=tuple(o.cameras[c] for c in keep), camera=number[o.camera])
    return replace(session, cameras=tuple(session.cameras[c] for c in keep), observations=o)


def _without_source(session: Session, source: str) -> Session:
    """The session without one of its sources of scale; without the bar, the print gives it, as far as it is known."""
    if source != "bar" or session.scale is None or session.scale.kind != "bar":
        return replace(session, struck=(*session.struck, source))
    widest = None if session.target_set is None else session.target_set.widest()
    surface = "flat" if session.sphere_diameter_mm is None else "sphere"
    return replace(session, scale=None if widest is None else Scale("target_spacing", *widest, surface))


def _swapped(session: Session, a: int, b: int, placement: int | None) -> Session:
    names = {session.cameras[a].id: session.cameras[b].id, session.cameras[b].id: session.cameras[a].id}
    there = _with_images(
        session, lambda t, images: {names.get(c, c): p for c, p in images.items()} if placement in (None, t) else images
    )
    o = session.observations
    if o is None:
        return there
    here = np.ones(len(o), dtype=bool) if placement is None else o.placement == placement
    camera = o.camera.copy()
    camera[here & (o.camera == a)] = b
    camera[here & (o.camera == b)] = a
    return replace(there, observations=replace(o, camera=camera))


def _name_before(camera: str, placement: str) -> str:
    return f"{camera} before {placement}"


def _split(session: Session, index: int, placement: int) -> Session:
    spec = session.cameras[index]
    earlier = replace(spec, id=_name_before(spec.id, _places(session)[placement].id), earlier_pose_of=spec.id)
    name, count = _places(session)[placement].id, len(_places(session))
    for part, key in ((range(placement), "error-nothing-before"), (range(placement, count), "error-nothing-from")):
        if not _seen(session, index, part):
            raise InputError(Phrase(key, {"camera": spec.id, "place": name}))
    there = _with_images(
        session, lambda t, images: {earlier.id if c == spec.id and t < placement else c: p for c, p in images.items()}
    )
    cameras = (*session.cameras, earlier)
    o = session.observations
    if o is None:
        return replace(there, cameras=cameras)
    camera = np.where((o.camera == index) & (o.placement < placement), len(session.cameras), o.camera)
    return replace(there, cameras=cameras, observations=replace(o, cameras=(*o.cameras, earlier.id), camera=camera))


def _seen(session: Session, camera: int, placements: range) -> int:
    """How many images (or observations) a camera has in some placements."""
    o = session.observations
    if o is not None:
        return int(((o.camera == camera) & (o.placement >= placements.start) & (o.placement < placements.stop)).sum())
    name = session.cameras[camera].id
    return sum(name in _places(session)[t].images for t in placements)


_Images = dict[str, Path]


def _with_images(session: Session, change: Callable[[int, _Images], _Images]) -> Session:
    """The session with the images of each placement (by index) changed."""
    n = len(session.placements)
    return replace(
        session,
        placements=tuple(replace(p, images=change(t, p.images)) for t, p in enumerate(session.placements)),
        bar_poses=tuple(replace(p, images=change(n + t, p.images)) for t, p in enumerate(session.bar_poses)),
    )


def _under_old_names(o: Observations, session: Session, mended: Session) -> Observations:
    """Observations of a mended session as those of the original cameras; those left out have none."""
    home = {camera.id: camera.earlier_pose_of or camera.id for camera in mended.cameras}
    left = tuple(camera.id for camera in session.cameras if camera.id in home)
    number = np.array([left.index(home[name]) for name in o.cameras], dtype=np.int64)
    return replace(o, cameras=left, camera=number[o.camera])
