"""A project: what the wizard knows of one calibration. Frozen; each change is a function that gives a new one."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Literal

_DIGITS = 32  # of the SHA-256: two contents never share them by chance


def fingerprint(content: object) -> str:
    """A short text (hexadecimal) that is equal for equal content."""
    text = json.dumps(_plain(content), sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _plain(content: object) -> object:
    if is_dataclass(content) and not isinstance(content, type):
        values = ((one, getattr(content, one.name)) for one in fields(content))
        # without those that have their default: one that a later version adds changes no fingerprint of before
        return {one.name: _plain(value) for one, value in values if value != _default(one)}
    if isinstance(content, Mapping):
        return {str(key): _plain(value) for key, value in content.items()}
    if isinstance(content, Sequence) and not isinstance(content, str):
        return [_plain(value) for value in content]
    return content


def _default(one: "Field[object]") -> object:
    if one.default is not MISSING:
        return one.default
    return one.default_factory() if one.default_factory is not MISSING else MISSING


# The engine's own FEW_PLACEMENTS (spherecal.diagnose.run_checks; a test compares them), which takes a second to import.
FEW_PLACEMENTS = 3

Verdict = Literal[
    "valid", "use with care", "not valid", "consistent", "pass", "undecided", "inconsistent", "no data", "ok", "watch",
    "recalibrate",
]  # fmt: skip
Purpose = Literal["calibrate", "check", "verify"]
Rectangle = tuple[float, float, float, float]  # left, top, width, height in px, as in spherecal.targets.masks


VERIFIED: tuple[Verdict, ...] = ("consistent", "pass")  # the verdicts of a verification that found nothing wrong

FlawCode = Literal["taken without", "taken moving", "moved since"]


@dataclass(frozen=True)
class Flaw:
    """What is wrong with a set as it was taken at `taken`: the code and the cameras; `kept`: somebody keeps it so."""

    set_id: str
    taken: str
    code: FlawCode
    cameras: tuple[str, ...]
    kept: bool = False


def usable(verdict: Verdict) -> bool:
    """Whether a calibration with this verdict may be put to use, be it with care."""
    return verdict in ("valid", "use with care")


@dataclass(frozen=True)
class Artefacts:
    """What is on the bench, as somebody has confirmed it: words for people, and the bars by id."""

    target_set: str = ""
    ball: str = ""
    scale: str = ""
    scale_bar: str | None = None  # gives the scale; None: the targets' spacing does
    check_bars: tuple[str, ...] = ()  # verify; a bar is never both
    check: str = ""  # the words for them
    board: bool = False  # a board calibrates, not a ball


@dataclass(frozen=True)
class Computation:
    """One finished computation: from which inputs it came, what it said."""

    inputs: tuple[tuple[str, str], ...]  # name; moment of taking, words or fingerprint
    verdict: Verdict


@dataclass(frozen=True)
class Project:
    """The state of one project; nothing in it says what is blocked or stale: `workflow.resolve` computes that."""

    folder: Path
    source: str
    bench: str = ""  # the file that describes targets, ball and bars where the source does not
    cameras: tuple[str, ...] = ()  # serials chosen at Connect
    artefacts: Artefacts | None = None
    looked: tuple[str, ...] = ()  # serials that were looked at
    placements: tuple[str, ...] = ("P1", "P2", "P3", "P4")  # planned, as are the poses
    scale_poses: tuple[str, ...] = ()
    check_poses: tuple[str, ...] = ()
    taken: Mapping[str, str] = field(default_factory=dict)  # id -> moment of taking
    calibrated: Computation | None = None
    accepted: Computation | None = None
    verified: Computation | None = None
    saved: Computation | None = None
    step: str = "connect"  # where the user is
    failures: Mapping[str, str] = field(default_factory=dict)  # step -> the error of its last attempt
    repairs: tuple[tuple[str, str], ...] = ()  # asked for at the next calibration, such as ("--leave-out", "C05@P3")
    purpose: Purpose = "calibrate"
    checked: Computation | None = None  # the quick check of the calibration in use
    repaired: Computation | None = None  # cameras that it found moved
    masks: tuple[tuple[str, Rectangle], ...] = ()  # by camera, in which nothing is a target; as drawn
    limit: str = ""  # of the length errors, as somebody has written it
    pose_bars: tuple[tuple[str, str], ...] = ()  # which bar a guided pose of a check bar is of
    bar_celsius: float | None = None  # as somebody has read it
    flaws: tuple[Flaw, ...] = ()  # of all sets ever taken: one that is brought back has its own again
    note: str = ""  # the operator's
    method: str = ""  # as on the command line; empty for the program's own

    def flaws_of(self, set_id: str) -> tuple[Flaw, ...]:
        """What is wrong with a set as it is now."""
        at = self.taken.get(set_id)
        return tuple(one for one in self.flaws if one.set_id == set_id and one.taken == at)

    @property
    def simulated(self) -> bool:
        """Whether its cameras are simulated: then nothing of it counts for a real rig."""
        return self.source.startswith("simulated")

    @property
    def by_board(self) -> bool:
        """Whether a board calibrates, not a ball: then a camera need not see it at every placement."""
        return self.artefacts is not None and self.artefacts.board

    @property
    def sets(self) -> tuple[str, ...]:
        """The ids of everything that calibration needs: placements, then poses of the bar that gives the scale."""
        return self.placements + self.scale_poses

    @property
    def calibration_inputs(self) -> tuple[tuple[str, str], ...]:
        """What a calibration made now would be made from; that of a verification comes from the profile."""
        if self.purpose == "verify":
            return (*(self.calibrated.inputs if self.calibrated else ()), *self._moved_inputs)
        sets = tuple((name, self.taken[name]) for name in self.sets if name in self.taken)
        words = " ".join(f"{option} {value}" for option, value in self.repairs_now)
        repairs = (("repairs", words),) if words else ()
        method = (("method", self.method),) if self.method else ()
        given = (("artefacts", fingerprint(self.artefacts)), *repairs, *method)
        return (*sets, *given, *self._mask_inputs, *self._moved_inputs)

    @property
    def _moved_inputs(self) -> tuple[tuple[str, str], ...]:
        """Cameras that were moved after a set was taken: what was computed from it holds for them no more."""
        moved = {
            camera
            for name in (*self.sets, *self.check_poses)
            for one in self.flaws_of(name)
            if one.code == "moved since"
            for camera in one.cameras
        }
        return (("moved", ", ".join(sorted(moved))),) if moved else ()

    @property
    def _mask_inputs(self) -> tuple[tuple[str, str], ...]:
        return (("masks", fingerprint(sorted(self.masks))),) if self.masks else ()

    @property
    def repairs_now(self) -> tuple[tuple[str, str], ...]:
        """The repairs that can be done with the sets that are there."""
        return tuple(one for one in self.repairs if repaired_set(one[1]) in (None, *self.taken))

    @property
    def verification_inputs(self) -> tuple[tuple[str, str], ...]:
        """What a verification made now would be made from: the calibration, and the poses of check bars."""
        sets = tuple((name, self.taken[name]) for name in self.check_poses if name in self.taken)
        limit = (("limit", self.limit),) if self.limit else ()
        return (*sets, ("calibration", fingerprint(self.calibrated)), *limit, *self._mask_inputs)

    @property
    def check_inputs(self) -> tuple[tuple[str, str], ...]:
        """What a check made now would be made from."""
        sets = tuple((name, self.taken[name]) for name in self.placements if name in self.taken)
        return (*sets, *self._mask_inputs) if sets else ()

    @property
    def result_folder(self) -> Path:
        """Where the calibration's result is."""
        return self.folder / "result"

    @property
    def repair_folder(self) -> Path:
        """Where the rig is in which a check has put cameras right."""
        return self.folder / "repair"

    @property
    def verification_folder(self) -> Path:
        """The session of check bars: apart, so that a calibration's input never changes by verifying it."""
        return self.folder / "verification"


def with_cameras(project: Project, cameras: tuple[str, ...]) -> Project:
    """The cameras chosen; those of a project that has sets stay as they are."""
    return project if project.taken else replace(project, cameras=cameras)


def with_set(
    project: Project, name: str, taken: str, flaws: Mapping[FlawCode, tuple[str, ...]] | None = None
) -> Project:
    """A set was taken (or taken again) at this moment; what was to be mended about the one before is past."""
    again = project.taken.get(name, taken) != taken
    repairs = tuple(one for one in project.repairs if not (again and repaired_set(one[1]) == name))
    own = tuple(Flaw(name, taken, code, cameras) for code, cameras in (flaws or {}).items() if cameras)
    return replace(project, taken={**project.taken, name: taken}, repairs=repairs, flaws=(*project.flaws, *own))


def with_moved(project: Project, cameras: tuple[str, ...]) -> Project:
    """These cameras count as they stand now: what was taken before shows them where they were."""
    own = tuple(Flaw(name, at, "moved since", cameras) for name, at in project.taken.items())
    return replace(project, flaws=(*project.flaws, *own)) if cameras else project


def with_kept(project: Project, name: str) -> Project:
    """Somebody keeps a set as it is, with what is wrong with it."""
    mine = project.flaws_of(name)
    return replace(project, flaws=tuple(replace(one, kept=True) if one in mine else one for one in project.flaws))


def repaired_set(value: str) -> str | None:
    """The set that a repair is about: of `C05@P3`, `C05,C06@P3`, `placement:P3`; None where it is about all."""
    if value.startswith("placement:"):
        return value.removeprefix("placement:")
    return value.rpartition("@")[2] if "@" in value else None


def without_set(project: Project, name: str) -> Project:
    """A set was deleted; it stays planned."""
    return replace(project, taken={key: value for key, value in project.taken.items() if key != name})


def with_another_placement(project: Project) -> Project:
    """One more placement is planned."""
    number = 1 + max((int(name[1:]) for name in project.placements if name[1:].isdecimal()), default=0)
    return replace(project, placements=(*project.placements, f"P{number}"))


def without_placement(project: Project, name: str) -> Project:
    """A placement that was not taken is no longer planned; no fewer are planned than a calibration needs."""
    if name in project.taken or len(project.placements) <= FEW_PLACEMENTS:
        return project
    return replace(project, placements=tuple(one for one in project.placements if one != name))


def with_calibration(project: Project, verdict: Verdict) -> Project:
    """A calibration of the present inputs was finished."""
    return without_failure(replace(project, calibrated=Computation(project.calibration_inputs, verdict)), "calibrate")


def with_verification(project: Project, verdict: Verdict) -> Project:
    """A verification of the present inputs was finished."""
    return without_failure(replace(project, verified=Computation(project.verification_inputs, verdict)), "verify")


def with_check(project: Project, verdict: Verdict) -> Project:
    """A check of the present inputs was finished."""
    return without_failure(replace(project, checked=Computation(project.check_inputs, verdict)), "check")


def with_poses(project: Project, poses: tuple[tuple[str, str], ...]) -> Project:
    """Other poses of the check bars are planned; those that were taken stay."""
    ids = [pose for pose, _ in poses]
    kept = tuple(pose for pose in project.check_poses if pose in project.taken and pose not in ids)
    bars = tuple(one for one in project.pose_bars if one[0] in kept)
    return replace(project, check_poses=(*kept, *ids), pose_bars=(*bars, *poses))


def with_mask(project: Project, camera: str, rectangle: Rectangle) -> Project:
    """One more part of a camera's image in which nothing is a target."""
    return replace(project, masks=(*project.masks, (camera, rectangle)))


def with_repaired(project: Project, verdict: Verdict) -> Project:
    """The cameras that a check found moved were recalibrated."""
    inputs = (("check", fingerprint(project.checked)),)
    return without_failure(replace(project, repaired=Computation(inputs, verdict)), "check")


def with_repair_in_use(project: Project) -> Project:
    """The repaired calibration was put to use."""
    if project.repaired is None:
        return project
    return replace(project, saved=Computation((("repair", fingerprint(project.repaired)),), project.repaired.verdict))


def with_saved(project: Project) -> Project:
    """Calibration and verification as they are now were saved."""
    if project.calibrated is None:
        return project
    saved = Computation(saved_inputs(project), project.calibrated.verdict)
    return without_failure(replace(project, saved=saved), "save")


def saved_inputs(project: Project) -> tuple[tuple[str, str], ...]:
    """What would be saved now."""
    return (("calibration", fingerprint(project.calibrated)), ("verification", fingerprint(project.verified)))


def with_repair(project: Project, option: str, value: str) -> Project:
    """A repair is asked for; one that is there already stays as it is."""
    if (option, value) in project.repairs:
        return project
    return replace(project, repairs=(*project.repairs, (option, value)))


def without_repair(project: Project, option: str, value: str) -> Project:
    """A repair is taken back."""
    return replace(project, repairs=tuple(one for one in project.repairs if one != (option, value)))


def with_failure(project: Project, step: str, text: str) -> Project:
    """The work of a step ended with an error."""
    return replace(project, failures={**project.failures, step: text})


def without_failure(project: Project, step: str) -> Project:
    """The work of a step is tried again, or has succeeded."""
    return replace(project, failures={key: text for key, text in project.failures.items() if key != step})
