"""The marks of a waved bar: which observations show them, and the known lengths between them frame by frame."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.state import State
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.session import Bar, BarLength, Mark, Session
from spherecal.scale.bar_temperature import reference_length
from spherecal_boards.frame_network import FrameModel, Ties
from spherecal_boards.frames_adjustment import PointRows


@dataclass(frozen=True)
class Lengths:
    """Known distances inside frames: frame (m,), coefficients (m,s) of its slots, length (m,) and sigma (m,) in mm.

    Coefficients: second end less first, an end being a slot or a weighted sum of dots. `certificate` (m,): which length
    it is; `scatter`, mm: the bar's own share in `sigma`.
    """

    frame: IntArray
    coefficient: FloatArray
    length: FloatArray
    sigma: FloatArray
    certificate: IntArray
    scatter: float = 0.0


@dataclass(frozen=True)
class BarModel(FrameModel):
    """The frames of a bar: point `frame * parts + slot`, three unknowns a slot."""

    lengths: Lengths

    def ties(self, state: State) -> Ties:
        """The lengths' rows, over their standard uncertainties."""
        difference = self.differences(state)
        size = np.linalg.norm(difference, axis=1)
        along = difference / (size * self.lengths.sigma)[:, None]
        rows = (self.lengths.coefficient[:, :, None] * along[:, None]).reshape(len(size), -1)
        return Ties(self.lengths.frame, rows, (size - self.lengths.length) / self.lengths.sigma)

    def differences(self, state: State) -> FloatArray:
        """From each length's first end to its second, (m,3)."""
        points = state.points.reshape(-1, self.parts, 3)[self.lengths.frame]
        return np.einsum("ms,msi->mi", self.lengths.coefficient, points)

    def moved_frames(self, state: State, step: FloatArray) -> State:
        """The state with its points moved by the shifts of each frame's slots, (f,3s)."""
        return replace(state, points=state.points + step.reshape(-1, 3))

    def point_rows(self, state: State, points: IntArray) -> PointRows:
        """Points (p,) of the problem in the world, and how they follow their frames; all define the datum."""
        by_frame = np.zeros((len(points), self.parts, 3, 3))
        by_frame[np.arange(len(points)), points % self.parts] = np.eye(3)
        by_frame = by_frame.transpose(0, 2, 1, 3).reshape(len(points), 3, -1)
        return PointRows(points // self.parts, state.points[points], by_frame, np.ones(len(points), dtype=bool))


# A certificate of micrometres ties marks as if they were one body; no real bar is stiffer while it is waved.
_LEAST_TIE_MM = 1e-3
_LEAST_DOTS = 4


@dataclass(frozen=True)
class BarRecording:
    """What the cameras saw of the bar: observation i is of point `point[i]` = frame * slots + slot.

    `slot_target` and `slot_point` (s,) (index of the point's name) say what a slot is, `pose` (f,) which placement
    index of the observations a frame is.
    """

    bar: Bar
    observations: Observations
    point: IntArray
    slot_target: IntArray
    slot_point: IntArray
    pose: IntArray
    temperature_c: tuple[float | None, ...]

    @property
    def slots(self) -> int:
        """Points of a frame."""
        return len(self.slot_target)

    @property
    def n_frames(self) -> int:
        """How many frames."""
        return len(self.pose)

    @property
    def n_points(self) -> int:
        """Points of all frames, seen or not."""
        return self.slots * self.n_frames


def scale_bar(session: Session) -> Bar:
    """The bar that the session's scale names."""
    scale = session.scale
    if scale is None or scale.kind != "bar":
        raise InputError(Phrase("error-bar-needed", {"folder": session.where}))
    bar = next(bar for bar in session.bars if bar.id == scale.bar)
    if not any(pose.bar == bar.id for pose in session.bar_poses):
        raise InputError(Phrase("error-no-bar-poses", {"folder": session.where, "bar": bar.id}))
    return bar


def bar_recording(session: Session, bar: Bar) -> BarRecording:
    """The observations of a bar's marks in all poses, by their own names or as dots of targets about them."""
    o = session.observations
    assert o is not None
    first = len(session.placements)
    poses = [(first + i, pose) for i, pose in enumerate(session.bar_poses) if pose.bar == bar.id]
    frame_of = np.full(len(o.placements), -1)
    frame_of[[index for index, _ in poses]] = np.arange(len(poses))
    requested = [mark.target for mark in bar.marks.values()]
    keep = (frame_of[o.placement] >= 0) & np.isin(o.target, requested)
    by_dots = {mark.target for mark in bar.marks.values() if mark.point == "centre"}
    # a mark observed under its own name needs no dots
    named = {(mark.target, mark.point) for mark in bar.marks.values()}
    own = o.select(keep)
    kinds = np.unique(np.stack([own.target, own.point]), axis=1) if len(own) else np.zeros((2, 0), dtype=np.int64)
    slots = [
        (int(t), int(p))
        for t, p in kinds.T
        if (int(t), o.points[p]) in named or (int(t) in by_dots and _layout(session, int(t)) is not None)
    ]
    if not slots:
        raise InputError(Phrase("error-no-marks", {"folder": session.where, "bar": bar.id}))
    lookup = {slot: i for i, slot in enumerate(slots)}
    slot = np.array([lookup.get(key, -1) for key in zip(own.target.tolist(), own.point.tolist(), strict=True)])
    own, slot = own.select(slot >= 0), slot[slot >= 0]
    target, point = (np.array([one[i] for one in slots]) for i in (0, 1))
    pose, temperature_c = np.array([index for index, _ in poses]), tuple(pose.temperature_c for _, pose in poses)
    return BarRecording(bar, own, frame_of[own.placement] * len(slots) + slot, target, point, pose, temperature_c)


def known_lengths(session: Session, recording: BarRecording, seen: BoolArray) -> Lengths:
    """The certified lengths of every frame both of whose ends are given by points (points,) that are `seen`."""
    seen = seen.reshape(recording.n_frames, recording.slots)
    rows: list[tuple[IntArray | FloatArray, ...]] = []
    for number, certified in enumerate(recording.bar.lengths):
        ends = [
            _end(session, recording, recording.bar.marks[name], seen)
            for name in (certified.from_mark, certified.to_mark)
        ]
        both = np.flatnonzero(np.isfinite(ends[0][:, 0]) & np.isfinite(ends[1][:, 0]))
        length = np.array([reference_length(certified, recording.bar, t) for t in recording.temperature_c])
        standard = max(standard_uncertainty(certified), _LEAST_TIE_MM)
        each = np.full(len(both), standard), np.full(len(both), number)
        rows.append((both, (ends[1] - ends[0])[both], length[both], *each))
    frame, coefficient, length, sigma, certificate = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Lengths(frame, coefficient, length, sigma, certificate)


def standard_uncertainty(certified: BarLength) -> float:
    """A certificate's standard uncertainty in mm."""
    return certified.expanded_uncertainty_mm / certified.coverage_factor


def _layout(session: Session, target: int) -> dict[str, FloatArray] | None:
    return session.target_set.layouts.get(target) if session.target_set is not None else None


def _end(session: Session, recording: BarRecording, mark: Mark, seen: BoolArray) -> FloatArray:
    """Coefficients (f,s) that give a mark in every frame; NaN where it cannot be found."""
    names = recording.observations.points
    of_target = recording.slot_target == mark.target
    direct = [i for i in np.flatnonzero(of_target) if names[recording.slot_point[i]] == mark.point]
    out = np.full(seen.shape, np.nan)
    if direct:
        out[seen[:, direct[0]]] = np.eye(seen.shape[1])[direct[0]]
    layout = _layout(session, mark.target)
    if mark.point != "centre" or layout is None:
        return out
    dots = np.array([i for i in np.flatnonzero(of_target) if names[recording.slot_point[i]] in layout], dtype=np.int64)
    flat = np.array([layout[names[recording.slot_point[i]]] for i in dots]).reshape(-1, 2)
    todo = np.flatnonzero(np.isnan(out[:, 0]))
    patterns, which = np.unique(seen[todo][:, dots], axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        coefficient = _origin_of(flat[pattern])
        if coefficient is not None:
            row = np.zeros(seen.shape[1])
            row[dots[pattern]] = coefficient
            out[todo[which.reshape(-1) == number]] = row
    return out


def _origin_of(flat: FloatArray) -> FloatArray | None:
    """Coefficients (k,), of least norm, by which dots at flat (k,2) give their layout's origin; None without any."""
    if len(flat) < _LEAST_DOTS:
        return None
    rows = np.vstack([np.ones(len(flat)), flat.T])
    if np.linalg.matrix_rank(flat - flat.mean(axis=0), tol=1.0) < 2:  # in line, to a millimetre
        return None
    return np.asarray(np.linalg.pinv(rows)[:, 0], dtype=np.float64)
