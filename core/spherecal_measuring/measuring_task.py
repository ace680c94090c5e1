"""What is to be measured: points by name, distances, angles, reference bars, bodies."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray
from spherecal.base.errors import InputError
from spherecal.base.file_reading import id_problem
from spherecal.base.messages.values import Phrase
from spherecal.data.session import Bar
from spherecal.targets.target_set import TargetSet
from spherecal_files.bar_registry import RegisteredBar

CENTRE = "centre"
_MOST_TARGET = 2**40  # keys of points are target * 1024 + point


@dataclass(frozen=True, order=True)
class PointName:
    """A point of a target; `centre` is the origin of the target's layout."""

    target: int
    point: str = CENTRE

    def __str__(self) -> str:
        return str(self.target) if self.point == CENTRE else f"{self.target}/{self.point}"


def parse_point(text: str) -> PointName:
    """The name of a point in a text: `12` is the centre of target 12, `12/A` its point A."""
    number, slash, point = text.strip().partition("/")
    if number.isdecimal() and int(number) < _MOST_TARGET and bool(slash) == bool(point):
        if not slash:
            return PointName(int(number))
        if id_problem(point) is None:
            return PointName(int(number), point)
    raise InputError(Phrase("error-no-point", {"text": text[:60]}))


@dataclass(frozen=True)
class Ruler:
    """A distance between two points in mm, or the angle at the second of three in degrees, with its nominal value."""

    points: tuple[PointName, ...]
    nominal: float | None = None

    @property
    def kind(self) -> Literal["distance", "angle"]:
        """What it measures, by the number of its points."""
        return "distance" if len(self.points) == 2 else "angle"

    @property
    def name(self) -> str:
        """The points, joined by hyphens."""
        return "-".join(map(str, self.points))


def parse_ruler(text: str, points: Literal[2, 3]) -> Ruler:
    """The ruler in a text: `12,14` or `12,14=400.05` (mm) with two points, `12,13,14=90` (degrees) with three."""
    what = Phrase("a-distance" if points == 2 else "an-angle")
    names, equals, nominal = text.partition("=")
    found = tuple(parse_point(name) for name in names.split(","))
    if len(found) != points or len(set(found)) < points:
        example = "12,14 or 12,14=400.05" if points == 2 else "12,13,14 or 12,13,14=90"
        raise InputError(
            Phrase("error-ruler-points", {"text": text[:60], "what": what, "points": points, "example": example})
        )
    if not equals:
        return Ruler(found)
    try:
        value = float(nominal)
    except ValueError:
        value = np.nan
    if not 0 <= value < 1e9:
        raise InputError(Phrase("error-ruler-nominal", {"what": what, "text": text[:60]}))
    return Ruler(found, value)


@dataclass(frozen=True)
class BodyPoint:
    """A point of a body: its name, its place (3,) in the body's frame in mm, and its standard uncertainty."""

    name: PointName
    place_mm: tuple[float, float, float]
    sigma_mm: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Body(ByValue):
    """A rigid body by three or more named points that are not on one line."""

    name: str
    points: tuple[BodyPoint, ...]

    @property
    def places_mm(self) -> FloatArray:
        """The places (n, 3) of all points in the body's frame."""
        return np.array([point.place_mm for point in self.points], dtype=float).reshape(-1, 3)


@dataclass(frozen=True, eq=False, repr=False)
class Task(ByValue):
    """What to measure in every set, and what is known of the images.

    All targets that can be placed are measured; `points` are wanted besides (dots, points of other families). `bars`
    need a temperature for their expansion. `exposure_sd_s`: the standard uncertainty of a camera's moment of exposure,
    None to take it from the set. `correct_exposure`: move image points of moving targets to the set's moment by the
    cameras' own exposure times; only for cameras whose times are exact, as with PTP.

    Raises
    ------
    InputError
        Where two bodies, or two bars, have one name.
    """

    target_set: TargetSet | None = None
    points: tuple[PointName, ...] = ()
    rulers: tuple[Ruler, ...] = ()
    bars: tuple[Bar, ...] = ()
    bodies: tuple[Body, ...] = ()
    temperature_c: float | None = None
    exposure_sd_s: float | None = None
    correct_exposure: bool = False
    _wanted: frozenset[PointName] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        named = [*self.points, *(name for ruler in self.rulers for name in ruler.points)]
        named += [PointName(m.target, m.point) for bar in self.bars for m in bar.marks.values()]
        named += [point.name for body in self.bodies for point in body.points]
        object.__setattr__(self, "_wanted", frozenset(named))
        for what, names in (
            (Phrase("a-body"), [b.name for b in self.bodies]),
            (Phrase("a-bar"), [b.id for b in self.bars]),
        ):
            if twice := next((name for i, name in enumerate(names) if name in names[:i]), None):
                raise InputError(Phrase("error-same-file-name", {"what": what, "name": twice}))

    @property
    def wanted(self) -> frozenset[PointName]:
        """All points that are asked for by name."""
        return self._wanted


def registered(bar: RegisteredBar) -> Bar:
    """A bar of the owner's registry, to be measured."""
    return Bar(
        bar.serial, "check", bar.marks, bar.lengths, bar.expansion_per_kelvin, bar.reference_temperature_c,
        bar.serial, bar.certificate, bar.assumed,
    )  # fmt: skip
