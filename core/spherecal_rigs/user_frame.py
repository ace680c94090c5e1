"""The user's frame: origin, +X and the XY plane by three places, an offset, turns by 90 degrees."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import ByValue, FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.rotation import exp_rotation, log_rotation

TURNS = ("x90", "x-90", "y90", "y-90", "z90", "z-90")

# The angle at the origin between the two other places, folded to 0..90 degrees. Over 4095 triples of 15 centres of
# spheres fitted to a ball out of round (rig A simulated, seeds 1 to 3) the turn about X errs by 0.6 degrees (median;
# 2.8 at 95 %) between 5 and 10 degrees, by 1.9 (11) between 2 and 5, by 0.09 (0.5) above 60; of a rigid ball's
# centres by 0.001 (0.005), 0.003 (0.02), 0.0003 (0.001).
LEAST_ANGLE_DEG = 5.0
# Centres of fitted spheres err by 0.24 mm rms per coordinate (same sessions): X would be a degree off at 20 mm.
_LEAST_DISTANCE = 20.0
_MOST_MM = 1e7  # ten kilometres; NaN is none either


@dataclass(frozen=True)
class FrameDefinition:
    """How a user's frame is defined: the names of three places, or none of them for the reference camera's frame.

    `offset_mm` is the position of the origin's place (or the reference camera) in the frame before the `turns`. These
    turn the axes about themselves one after the other, right-handed: after "z90" X points where Y did.
    """

    origin: str | None = None
    x: str | None = None
    xy: str | None = None
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turns: tuple[str, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        """The three names, or none."""
        given = tuple(name for name in (self.origin, self.x, self.xy) if name is not None)
        if len(given) not in (0, 3):
            raise InputError(Phrase("error-three-places", {"places": len(given)}), Phrase("error-name-three"))
        if len(set(given)) < len(given):
            twice = next(name for name in given if given.count(name) > 1)
            raise InputError(Phrase("error-place-twice", {"name": twice}), Phrase("error-need-three"))
        return given

    def words(self) -> str:
        """The definition in one line."""
        about = f"origin {self.origin}, +X {self.x}, XY {self.xy}" if self.places else "the reference camera"
        offset = " ".join(f"{value:g}" for value in self.offset_mm)
        return (
            about
            + (f", offset {offset} mm" if any(self.offset_mm) else "")
            + (f", turned {' '.join(self.turns)}" if self.turns else "")
        )


@dataclass(frozen=True, eq=False, repr=False)
class UserFrame(ByValue):
    """`x_user = rotation @ x_world + translation_mm`; the world is that of the rig.json it was defined on.

    `distance_mm` (origin to +X) and `angle_deg` (at the origin, from +X to the third place) say how well the places
    define it. `origin_sigma_mm` (3,) are the standard uncertainties of the origin along X, Y, Z and `axes_sigma_deg`
    (3,) those of the axes about them. They follow from those of the places, taken as independent; None where these are
    not known.
    """

    rotation: FloatArray
    translation_mm: FloatArray
    definition: FrameDefinition
    reference_camera: str | None = None
    input_sha256: str = ""
    distance_mm: float | None = None
    angle_deg: float | None = None
    origin_sigma_mm: FloatArray | None = None
    axes_sigma_deg: FloatArray | None = None

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """Points (n, 3) mm of the world in this frame."""
        return points_mm @ self.rotation.T + self.translation_mm

    @property
    def origin_mm(self) -> FloatArray:
        """Where this frame's origin is in the world, (3,) mm."""
        return -self.rotation.T @ self.translation_mm


def turn_matrix(turns: Sequence[str]) -> FloatArray:
    """The matrix (3, 3) that maps coordinates before the turns to those after them; whole numbers."""
    matrix = np.eye(3)
    for turn in turns:
        if turn not in TURNS:
            raise InputError(Phrase("error-no-turn", {"turn": turn, "turns": list(TURNS)}))
        vector = np.zeros(3)
        vector["xyz".index(turn[0])] = math.radians(float(turn[1:]))
        matrix = np.rint(exp_rotation(vector)).T @ matrix
    return matrix


def user_frame(
    definition: FrameDefinition,
    places_mm: FloatArray | None = None,
    covariances_mm2: FloatArray | None = None,
    unit: str = "mm",
) -> UserFrame:
    """The frame that three places in the world define, or an offset and turns of the world itself.

    `places_mm` (3, 3); None: the world itself; `covariances_mm2`: covariances of the places, (3, 3, 3); None where they
    are not known.
    """
    offset, turn = np.array(definition.offset_mm, dtype=float), turn_matrix(definition.turns)
    if not (np.abs(offset) <= _MOST_MM).all():
        raise InputError(Phrase("error-bad-offset", {"offset": str(definition.offset_mm), "most": _MOST_MM}))
    if not definition.places or places_mm is None:
        return UserFrame(turn, turn @ offset, definition)
    distance, angle = _checked(definition, places_mm, unit)

    def made(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = places[1] - places[0]
        x = x / np.linalg.norm(x)
        z = np.asarray(np.cross(x, places[2] - places[0]), dtype=float)
        z = z / np.linalg.norm(z)
        axes = np.array([x, np.cross(z, x), z], dtype=float)
        return turn @ axes, turn @ (offset - axes @ places[0])

    rotation, translation = made(places_mm)
    origin_sigma = axes_sigma = None
    if covariances_mm2 is not None and np.isfinite(covariances_mm2).all():
        origin_sigma, axes_sigma = _sigmas(made, places_mm, covariances_mm2)
    return UserFrame(
        rotation,
        translation,
        definition,
        distance_mm=distance,
        angle_deg=angle,
        origin_sigma_mm=origin_sigma,
        axes_sigma_deg=axes_sigma,
    )


def _checked(definition: FrameDefinition, places: FloatArray, unit: str) -> tuple[float, float]:
    """Distance from the origin to +X and the angle there; InputError where they define no frame."""
    names = definition.places
    for i, j in ((0, 1), (0, 2)):
        apart = float(np.linalg.norm(places[j] - places[i]))
        if apart < _LEAST_DISTANCE:
            raise InputError(
                Phrase("error-too-near", {"first": names[i], "second": names[j], "apart": apart, "unit": unit}),
                Phrase("error-far-apart", {"least": _LEAST_DISTANCE, "unit": unit}),
            )
    to_x, to_plane = places[1] - places[0], places[2] - places[0]
    angle = math.degrees(math.atan2(float(np.linalg.norm(np.cross(to_x, to_plane))), float(to_x @ to_plane)))
    if min(angle, 180 - angle) < LEAST_ANGLE_DEG:
        off = float(np.linalg.norm(np.cross(to_x, to_plane)) / np.linalg.norm(to_x))
        first, second, third = names
        values = {"names": names, "first": first, "second": second, "third": third, "off": off, "unit": unit}
        raise InputError(
            Phrase("error-in-a-line", {**values, "degrees": angle}),
            Phrase("error-off-the-line", {"degrees": LEAST_ANGLE_DEG}),
        )
    return float(np.linalg.norm(to_x)), angle


def _sigmas(
    made: Callable[[FloatArray], tuple[FloatArray, FloatArray]], places: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Standard uncertainties of the origin (3,) mm and the axes (3,) degrees, by central differences."""
    rotation, translation = made(places)
    origin = -rotation.T @ translation
    step = 1e-4 * float(np.linalg.norm(places[1] - places[0]))
    variances = np.zeros((6, 6))
    for p in range(3):
        columns = np.zeros((6, 3))
        for axis in range(3):
            ends = []
            for side in (step, -step):
                moved = places.copy()
                moved[p, axis] += side
                r, t = made(moved)
                ends.append(np.concatenate([rotation @ (-r.T @ t - origin), log_rotation(rotation @ r.T)]))
            columns[:, axis] = (ends[0] - ends[1]) / (2 * step)
        variances += columns @ covariances[p] @ columns.T
    sigma = np.sqrt(np.maximum(np.diag(variances), 0.0))
    return sigma[:3], np.degrees(sigma[3:])
