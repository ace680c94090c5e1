"""What each step says. All of a page's sentences about its state are made here, without widgets, and nowhere else."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from spherecal_gui import languages
from spherecal_gui.languages import reason_text, translate
from spherecal_gui.presenters.placement_presenter import Scene, is_stuck, ready_text, short_text
from spherecal_gui.standing import Button, Level, Said
from spherecal_gui.workflow import Reason, Status

if TYPE_CHECKING:  # imports scipy
    from spherecal_gui.tasks.ghost import ToGo

Work = Literal["", "exposing", "computing", "other"]  # computing: the images are there, ball and bar may be moved

_NAMED = 4  # cameras in one sentence
LEAST_MARKS = 2  # of a bar that a camera must see
LEAST_CAMERAS, GOOD_CAMERAS = 2, 3  # a mark is found in space by two; a third one shows when one of them is wrong


def _busy() -> str:
    return translate("State", "Work is running.")


def _unconnected() -> str:
    return translate("State", "The cameras are not connected.")


def _also(can: Mapping[str, bool]) -> frozenset[str]:
    return frozenset(key for key, on in can.items() if on)


# --- connect and camera check ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ConnectFacts:
    """What is known of cameras and bench."""

    summary: tuple[str, Level]  # connect_presenter.connect_summary
    cameras: bool = False
    confirmed: bool = False  # what is on the bench
    busy: bool = False
    described: bool = True  # it is known what should lie there


def connect_says(f: ConnectFacts) -> Said:
    """Confirm the bench: nobody calibrates with the wrong bar by default."""
    text, level = f.summary
    done = f.confirmed and f.cameras
    if f.busy:
        why = translate("State", "The cameras are being looked for.")
    elif not f.cameras:
        why = translate("State", "There are no cameras yet.")
    else:
        why = translate("State", "It was confirmed already.") if done else ""
    words = translate("State", "Bench confirmed") if done else translate("State", "Yes, this matches")
    if not why and not f.described:
        if level == "good":
            text = translate("State", "{cameras}. What is on the bench?").format(cameras=text)
        return Said(level, text, Button(translate("State", "Describe the bench"), "describe"))
    if level == "good" and not why:
        text = translate("State", "{cameras}. Is this on the bench?").format(cameras=text)
    return Said(level, text, Button(words, "confirm", not why, why, done=done and not f.busy, accepts=True))


@dataclass(frozen=True)
class LookFacts:
    """What is known of the images."""

    summary: tuple[str, Level]  # look_presenter.summary
    images: bool = False
    searched: bool = False  # for targets, all of them
    accepted: bool = False
    moved: bool = False


def look_says(f: LookFacts) -> Said:
    """Accept what is seen."""
    text, level = f.summary
    good = level in ("good", "none")
    words = translate("State", "The images are good") if good else translate("State", "Use the images as they are")
    if f.accepted:
        why = translate("State", "They were accepted already.")
        if level == "bad":
            why = translate("State", "See to the cameras that are named above.")
    elif f.searched:
        why = ""
    elif f.images:
        why = translate(
            "State", "Targets are being looked for. On a new computer the first time takes a minute or two."
        )
    else:
        why = translate("State", "Not every camera has sent an image yet.")
    button = Button(words, "accept", not why, why, f.accepted, True)
    return Said(level, text, button, also=_also({"fixed-again": f.moved}))


# --- placements ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PlacementFacts:
    """What is known while the ball, or a board, is put into place."""

    scene: Scene = field(default_factory=lambda: Scene({}, None))
    taken: bool = False
    flawed: bool = False
    work: Work = ""
    connected: bool = True
    as_before: bool = False
    to_go: "ToGo | None" = None  # None: not known
    enough: bool = False  # one more placement is not worth it
    recorded: bool = False  # nothing can be moved
    spare: bool = False  # it can be done without
    moved: bool = False
    undo: bool = False
    movable: bool = False
    spots: bool = False

    @property
    def away(self) -> bool:
        """Whether it is known not to be where it should go."""
        return self.to_go is not None and not self.to_go.near and not self.enough and not self.recorded

    @property
    def stuck(self) -> bool:
        """Whether it lies where it should, and a camera sees too little of it all the same."""
        return not self.recorded and is_stuck(self.scene, self.as_before, self.away)


def placement_says(f: PlacementFacts) -> Said:
    """One instruction at a time, the most urgent; where the ball goes is counted from where it lies now."""
    level, text = _placement_instruction(f)
    stay = ""
    if not f.taken:
        stay = translate("State", "Next, once this is captured.")
        if f.spare:
            stay = translate("State", "Next, once this is captured or skipped.")
    there = [name for name in f.scene.ready if name not in f.scene.lost]
    count = f"{len(there)} / {len(f.scene.counts)}"
    return Said(level, text, _placement_button(f), count, _placement_also(f), stay)


def _placement_button(f: PlacementFacts) -> Button:
    lost = languages.listed(f.scene.lost)
    words = translate("State", "Capture  (space)")
    if lost:
        words = translate("State", "Capture without {cameras}").format(cameras=lost)
    elif f.stuck:
        words = translate("State", "Capture anyway  (space)")
    if f.work in ("exposing", "computing"):
        return Button(translate("State", "Capturing"), "capture", False, _capturing(f.work))
    if f.work or (not f.connected and (f.flawed or not f.taken)):
        return Button(words, "capture", False, _busy() if f.work else _unconnected())
    if f.taken and f.flawed:
        return Button(translate("State", "Retake  (space)"), "capture")
    if f.taken and lost:
        return Button(translate("State", "Go on without {cameras}").format(cameras=lost), "next", accepts=True)
    words = translate("State", "Captured") if f.taken else words
    return Button(words, "capture", not f.taken, "", f.taken, not f.taken)


def _capturing(work: Work) -> str:
    if work == "exposing":
        return translate("State", "Images are being captured.")
    return translate("State", "The dots are being found in the images; the ball may be moved already.")


def _placement_also(f: PlacementFacts) -> frozenset[str]:
    """The small buttons that can be pressed now."""
    if f.work:
        return frozenset()
    return _also(
        {
            "retake": f.taken and not f.flawed and f.connected,
            "delete-set": f.taken,
            "skip": f.spare and not f.taken,
            "undo": f.undo,
            "keep-set": f.taken and f.flawed,
            "fixed-again": f.moved,
            "mask-spots": f.spots,
            "leave-spots": f.spots,
            "more": f.connected,
            "was-turned": f.as_before and not f.taken and not f.recorded and f.to_go is None,
            "put-there": f.away and not f.taken and f.movable,
        }
    )


def _placement_instruction(f: PlacementFacts) -> tuple[Level, str]:
    scene = f.scene
    lost, poor = languages.listed(scene.lost), list(scene.short)
    few, seen = languages.listed(poor[:_NAMED]), any(scene.counts.values())
    turn = translate("State", "Turn or move the ball: {names} sees too little").format(names=few)
    where = "" if f.to_go is None else move_text(f.to_go)
    before = translate("State", "Move the ball, or confirm that it was turned")
    of_board: tuple[tuple[bool, Level, str], ...] = (
        (not seen, "bad", translate("State", "Show the board to the cameras")),
        (f.as_before, "caution", translate("State", "Move the board: elsewhere, and tilted otherwise")),
        (scene.still is None, "none", translate("State", "Checking that the board is still")),
        (not scene.still, "caution", translate("State", "Hold the board still")),
        (True, "good", ready_text(())),
    )
    return _first(
        (f.work == "exposing", "caution", translate("State", "Hold still: images are being captured")),
        (f.work == "computing", "none", translate("State", "The images are there; their dots are being found")),
        (f.taken and f.flawed, "none", translate("State", "Retake it, or keep it as it is")),
        (f.taken, "good", translate("State", "Captured. Press space to go on")),
        (bool(lost), "bad", reason_text(Reason("cameras lost", scene.lost))),
        (f.recorded and not seen, "bad", translate("State", "The recording shows no targets here")),
        (f.recorded, "good", translate("State", "Recorded images. Press space to take them over")),
        *(of_board if scene.board else ()),
        (not seen, "bad", translate("State", "Put the ball where the cameras see it")),
        (f.away, "none", where),
        (f.stuck, "caution", short_text(scene.short)),
        (bool(poor) and not scene.made_up, "caution", turn),
        (f.as_before and f.to_go is None, "caution", before),
        (scene.still is None, "none", translate("State", "Checking that the ball is still")),
        (not scene.still, "caution", translate("State", "Let the ball come to rest")),
        (True, "good", ready_text(poor)),
    )


def _first(*rows: tuple[bool, Level, str]) -> tuple[Level, str]:
    """Level and text of the first row that applies: the most urgent comes first, and the last one always applies."""
    return next((level, text) for applies, level, text in rows if applies)


def move_text(to_go: "ToGo") -> str:
    """Where to put the ball and how to turn it, from where it lies now."""
    up, turn = round(to_go.up_mm, -1), to_go.turn_deg or 0.0
    if to_go.level_mm < 5 and abs(up) < 5:
        place = translate("State", "Leave the ball where it is")
    elif to_go.level_mm < 5:
        place = translate("State", "Move the ball {up:.0f} mm down")
        if up > 0:
            place = translate("State", "Move the ball {up:.0f} mm up")
    elif abs(up) < 20:
        place = translate("State", "Move the ball {away:.0f} mm towards {camera}")
    elif up > 0:
        place = translate("State", "Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm up")
    else:
        place = translate("State", "Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm down")
    place = place.format(away=max(round(to_go.level_mm, -1), 10), camera=to_go.towards, up=abs(up))
    if turn < 5:
        return place
    if to_go.tips_towards:
        words = translate("State", "tip its top {turn:.0f}° towards {camera}")
    elif to_go.to_the_left:
        words = translate("State", "turn it {turn:.0f}° to the left, as on a turntable")
    else:
        words = translate("State", "turn it {turn:.0f}° to the right, as on a turntable")
    words = words.format(turn=turn, camera=to_go.tips_towards)
    return translate("State", "{place}, {turn}").format(place=place, turn=words)


# --- bars ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BarFacts:
    """What is known while a bar is laid."""

    pose: str | None = None  # to take next; None: all are there
    seeing: int = 0  # cameras
    work: Work = ""
    connected: bool = True
    guide: tuple[str, Level, bool] | None = None  # sentence, level, whether it lies as asked
    recorded: bool = False


def bar_says(f: BarFacts) -> Said:
    """Take the next pose."""
    if f.work == "exposing":
        said = Said("caution", translate("State", "Hold still: images are being captured"))
    elif f.work == "computing":
        said = Said("none", translate("State", "The images are there; their dots are being found"))
    elif f.pose is None:
        said = Said("good", translate("State", "All poses are captured"))
    elif f.guide is not None:
        said = Said(f.guide[1], f"{f.pose} · {f.guide[0]}")
    else:
        level, text = _bar_seen(f)
        said = Said(level, f"{f.pose} · {text}")
    return replace(said, button=_bar_button(f))


def _bar_seen(f: BarFacts) -> tuple[Level, str]:
    if f.seeing < LEAST_CAMERAS and f.recorded:
        return "bad", translate("State", "The recording shows no bar here")
    if f.seeing < LEAST_CAMERAS:
        return "bad", translate("State", "Lay the bar where two cameras or more see it")
    if f.seeing < GOOD_CAMERAS:
        return "caution", translate("State", "Only two cameras see the bar; three are better")
    return "good", translate("State", "Ready: press space")


def _bar_button(f: BarFacts) -> Button:
    if f.pose is None:
        return Button(translate("State", "All poses captured"), "capture", False, done=True)
    words = translate("State", "Capture  (space)")
    if f.work:
        return Button(words, "capture", False, _capturing(f.work) if f.work != "other" else _busy())
    if not f.connected:
        return Button(words, "capture", False, _unconnected())
    if f.guide is not None and not f.guide[2]:
        return Button(words, "capture", False, f.guide[0])
    return Button(words, "capture", accepts=True)


@dataclass(frozen=True)
class VerifyFacts:
    """What is known of the check bars."""

    bar: BarFacts = field(default_factory=BarFacts)  # the pose that is laid
    outcome: tuple[str, Level] | None = None  # word and level of what was measured, where that is shown
    measuring: bool = False
    current: bool = True  # what was measured is of the poses, the calibration and the limit of now
    taken: bool = False
    outdated: bool = False  # the calibration itself is out of date
    empty: bool = False  # nothing could be measured in the poses that are there


def verify_says(f: VerifyFacts) -> Said:
    """Take poses, then measure."""
    words = translate("State", "Measure the bar")
    if f.measuring:
        text, why = translate("State", "Measuring"), translate("State", "Lengths are being measured.")
        return Said("none", text, Button(text, "measure", False, why))
    if f.outcome is not None:
        text, level = f.outcome
        return Said(level, text, _measured_button(f, words))
    said = bar_says(f.bar)
    if f.bar.pose is None and not f.bar.work:
        return replace(said, button=Button(words, "measure"))
    idle = not f.bar.work
    anyway = idle and f.bar.guide is not None and f.bar.connected
    return replace(said, also=_also({"measure-now": idle and f.taken, "take-anyway": anyway}))


def _measured_button(f: VerifyFacts, words: str) -> Button:
    if f.bar.work:
        return Button(words, "measure", False, _busy())
    if f.outdated:  # to measure with it would be in vain
        return Button(translate("State", "See what has changed"), "results")
    if f.empty and f.current:
        return Button(translate("State", "Retake  (space)"), "retake")
    again = translate("State", "It is measured; retake a pose to measure again.")
    return Button(words, "measure", False, again, done=True) if f.current else Button(words, "measure")


# --- calibrate and results -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CalibrateFacts:
    """How the calibration is."""

    status: Status = Status.READY
    reason: str = ""  # why it cannot be computed, has failed, or is out of date
    error: bool = False
    verdict: str = ""  # of what was taken; empty: nothing was computed of it
    run: Literal["", "running", "stopping", "keeping"] = ""  # keeping: it stops with what there is
    busy: bool = False
    taken: int = 0
    planned: int = 0
    left: str = ""


def calibrate_says(f: CalibrateFacts) -> Said:
    """Start, cancel, see what came of it."""
    words = translate("State", "Calibrate")
    if f.run == "stopping":
        why = translate("State", "The last stage is coming to its end.")
        stopping = Button(translate("State", "Stopping"), "cancel", False, why)
        return Said("caution", translate("State", "Stopping: what was captured is kept"), stopping)
    if f.run:
        text, level = translate("State", "Computing"), "none"
        if f.run == "keeping":
            text, level = translate("State", "Stopping as soon as there is a result"), "caution"
        return Said(level, text, Button(translate("State", "Cancel"), "cancel"), left=f.left)
    idle = Button(words, "calibrate", accepts=True)
    if f.busy or f.status is Status.BLOCKED:
        idle = replace(idle, enabled=False, why=_busy() if f.busy else f.reason)
    if f.verdict:
        return _computed(f)
    if f.status is Status.READY:
        text = translate("State", "Ready: {taken} of {planned} placements").format(taken=f.taken, planned=f.planned)
        return Said("good" if f.taken == f.planned else "caution", text, idle)
    if f.error:
        return Said("bad", translate("State", "It failed; what was captured is kept"), idle, left=f.reason)
    return Said("bad" if f.status is Status.FAILED else "caution", f.reason, idle)


def _computed(f: CalibrateFacts) -> Said:
    """It never says "again" where "Cancel" was a moment ago: a press too late would start another run."""
    also = _also({"calibrate-again": not f.busy and f.status is not Status.BLOCKED})
    if f.verdict == "valid":
        return Said("good", translate("State", "Done: the calibration is valid"), None, also=also)
    if f.verdict == "use with care":
        return Said("caution", translate("State", "Done: the calibration is to be used with care"), None, also=also)
    see = Button(translate("State", "See what to do"), "results")
    return Said("bad", translate("State", "Done: the calibration is not valid"), see, also=also)


@dataclass(frozen=True)
class ResultFacts:
    """What came out of the calibration."""

    verdict: tuple[str, Level, bool] | None = None  # word, level, may be used; None: it is being read
    stale: bool = False
    accepted: bool = False
    running: str = ""
    stopped: bool = False  # by somebody, before its end


def results_says(f: ResultFacts) -> Said:
    """Accept the result, or calibrate again where something was changed."""
    words = translate("State", "Accept the result")
    if f.verdict is None:
        text = translate("State", "Reading the result") if f.running else ""
        return Said("none", text, Button(words, "accept", False, translate("State", "The result is being read.")))
    word, level, may_use = f.verdict
    if f.running == "calibrate":
        why = translate("State", "A calibration is running: wait for what comes of it.")
        return Said("none", translate("State", "Being computed again"), Button(words, "accept", False, why))
    again = Button(translate("State", "Calibrate again"), "calibrate", not f.running, _busy() if f.running else "")
    if f.stale or f.stopped:
        return Said("caution", translate("State", "OUT OF DATE"), again) if f.stale else Said(level, word, again)
    if f.accepted:
        done = Button(words, "accept", False, translate("State", "It was accepted already."), done=True)
        return Said(level, word, done)
    if not may_use:
        why = translate("State", "It is not valid: do what the findings advise.")
        return Said(level, word, Button(words, "accept", False, why))
    return Said(level, word, Button(words, "accept", accepts=True))


# --- save, check, measure --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SaveFacts:
    """Whether the calibration is kept, and how good it is."""

    status: Status = Status.READY  # the step's
    calibration: str = "valid"  # its verdict
    verified: bool = True
    failed: bool = False
    kept: bool = False  # it is in the rig's profile as it is now
    stale: bool = False
    apply: bool = True  # it is put to use at once
    why_not: str = ""  # what is in the way
    report: bool = False
    running: str = ""
    stopping: bool = False
    left: str = ""
    undecided: bool = False  # the bar neither verified nor contradicted it


def save_says(f: SaveFacts) -> Said:
    """Save what is not in the profile yet; then the report; then the end."""
    level, text = _saved(f)
    if f.running == "save":
        cancel, why = Button(translate("State", "Cancel"), "cancel"), translate("State", "It was asked to stop.")
        if f.stopping:
            cancel = Button(translate("State", "Stopping"), "cancel", False, why)
        return Said(level, text, cancel, left=f.left)
    report = Button(translate("State", "Write the report"), "report")
    if f.running:
        return Said(level, text, replace(report, enabled=False, why=_busy()))
    if f.stale:
        return Said(level, text, Button(translate("State", "See what has changed"), "results"))
    if (f.status is Status.STALE or not f.kept) and not f.why_not:  # before the report is written
        words = translate("State", "Save and put to use") if f.apply else translate("State", "Save in the profile")
        return Said(level, text, Button(words, "save", accepts=f.apply))
    if f.report and f.status in (Status.DONE, Status.CARE):
        return Said(level, text, Button(translate("State", "Finish"), "finish", accepts=True))
    return Said(level, text, report)


def _saved(f: SaveFacts) -> tuple[Level, str]:
    """Saved, and how good that is: never greener than what was saved."""
    done = f.status in (Status.DONE, Status.CARE, Status.FAILED)
    return _first(
        (f.running == "save", "none", translate("State", "Writing")),
        (done and not f.kept, "caution", translate("State", "The calibration is not saved yet")),
        (f.status is Status.STALE, "caution", translate("State", "What was saved is out of date")),
        (not done and f.failed, "bad", translate("State", "Not saved yet; its verification failed")),
        (not done and f.verified, "none", translate("State", "Not saved yet")),
        (not done and f.undecided, "caution", translate("State", "Not saved yet; its verification decided nothing")),
        (not done, "caution", translate("State", "Not saved yet; not verified")),
        (f.calibration == "not valid", "bad", translate("State", "Saved; it is not valid")),
        (f.failed, "bad", translate("State", "Saved; its verification failed")),
        (f.undecided, "caution", translate("State", "Saved; its verification decided nothing")),
        (not f.verified, "caution", translate("State", "Saved; not verified")),
        (f.calibration != "valid", "caution", translate("State", "Saved; to be used with care")),
        (True, "good", translate("State", "Saved")),
    )


@dataclass(frozen=True)
class CheckFacts:
    """What is known of the check."""

    status: Status = Status.READY
    verdict: tuple[str, Level] | None = None  # word and level of the check that is shown, or that was made
    reason: str = ""  # why it is out of date or cannot be made
    well: bool = False  # nothing is to be done about the rig
    running: str = ""
    repaired: bool = False  # cameras were, and that can be put to use


def check_says(f: CheckFacts) -> Said:
    """Check; once the rig is known to be well, finish."""
    if f.running == "check":
        return Said("none", translate("State", "Checking"), Button(translate("State", "Cancel"), "cancel"))
    words = translate("State", "Check")
    if f.running or f.status is Status.BLOCKED:
        blocked = Button(words, "check", False, _busy() if f.running else f.reason)
        text, level = f.verdict or (translate("State", "Not done"), "caution")
        return Said(level, text, blocked)
    if f.verdict is not None and f.status is not Status.STALE:
        finish = Button(translate("State", "Finish"), "finish", accepts=True)
        again = Button(translate("State", "Check again"), "check")
        use = Button(translate("State", "Put the repair to use"), "use")
        button = finish if f.well else use if f.repaired else again
        return Said(f.verdict[1], f.verdict[0], button, also=_also({"check-again": f.well or f.repaired}))
    if f.reason:
        text = translate("State", "Not done")
        return Said("bad" if f.status is Status.FAILED else "caution", text, Button(words, "check"))
    return Said("good", translate("State", "Ready"), Button(words, "check"))


@dataclass(frozen=True)
class MeasureFacts:
    """What is known of the measurement."""

    trust: tuple[str, Level] = ("", "none")  # what is said of it, and its level
    measuring: bool = False
    recorded: int | None = None  # sets of the series; None: no series


def measure_says(f: MeasureFacts) -> Said:
    """Record a series, or end it."""
    text, level = f.trust
    if f.recorded is not None:
        left = translate("State", "Recording: {sets} sets").format(sets=f.recorded)
        return Said(level, text, Button(translate("State", "Stop recording"), "stop recording"), left=left)
    why = "" if f.measuring else translate("State", "Nothing is measured now.")
    return Said(level, text, Button(translate("State", "Record"), "record", f.measuring, why))


# --- time ------------------------------------------------------------------------------------------------------------

_SURE_AFTER_S, _SURE_SHARE = 2.0, 0.05
_LONGER = 1.25  # times what it usually takes: from here on it is said that this run takes longer


def seconds_left(elapsed_s: float, share: float, usual_s: float | None) -> float | None:
    """How long work still takes, by the `share` (0 to 1) that is done, at first by the last times; None: unknown."""
    by_share = elapsed_s * (1 - share) / share if elapsed_s >= _SURE_AFTER_S and share >= _SURE_SHARE else None
    by_habit = usual_s - elapsed_s if usual_s is not None and elapsed_s < usual_s else None
    if by_share is None or by_habit is None:
        return by_habit if by_share is None else by_share
    return share * by_share + (1 - share) * by_habit


def left_text(elapsed_s: float, share: float, usual_s: float | None) -> str:
    """How far work is and how long it still takes, for every place that says so; empty within the first second."""
    if elapsed_s < 1:
        return ""
    if usual_s is not None and elapsed_s > _LONGER * max(usual_s, 1.0):
        text = translate("State", "{seconds:.0f} s, longer than usual ({usual:.0f} s)")
        return text.format(seconds=elapsed_s, usual=usual_s)
    left = seconds_left(elapsed_s, share, usual_s)
    gone = translate("State", "{seconds:.0f} s").format(seconds=elapsed_s)
    if left is None:
        return gone
    if left < 5:
        return translate("State", "{gone}, nearly done").format(gone=gone)
    if left < 60:
        return translate("State", "{gone}, about {left} s left").format(gone=gone, left=5 * round(left / 5))
    return translate("State", "{gone}, about {left} min left").format(gone=gone, left=round(left / 60))


def seeing(targets: Mapping[str, int]) -> int:
    """The cameras that see two marks of the bar or more."""
    return sum(count >= LEAST_MARKS for count in targets.values())
