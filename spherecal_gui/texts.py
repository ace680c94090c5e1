"""Words for what the workflow says by code; all that people read passes through Qt's translation."""

from typing import TYPE_CHECKING

from spherecal.base.errors import OutputError, SpherecalError, reason
from spherecal.base.messages.values import Phrase
from spherecal_gui import languages
from spherecal_gui.languages import translate
from spherecal_gui.workflow import Reason, Status, Step, StepKind

if TYPE_CHECKING:  # the window is shown before cameras are loaded
    from spherecal_cameras.protocol import CameraStatus


def step_title(step: Step) -> str:
    """The step's name on the rail."""
    if step.kind == "placement":
        return translate("Steps", "Placement {name}").format(name=(step.set_id or "").removeprefix("P"))
    return {
        "connect": translate("Steps", "Connect"),
        "look": translate("Steps", "Camera check"),
        "scale": translate("Steps", "Scale bar"),
        "calibrate": translate("Steps", "Calibrate"),
        "results": translate("Steps", "Results"),
        "verify": translate("Steps", "Verify"),
        "save": translate("Steps", "Save"),
        "check": translate("Steps", "Check"),
        "measure": translate("Steps", "Measure"),
    }[step.kind]


def step_task(step: Step) -> str:
    """What is to be done in the step, in one sentence."""
    return {
        "connect": translate("Steps", "Find the cameras and confirm what is on the bench."),
        "look": translate("Steps", "Look at every camera: sharp, well lit, nothing in the way."),
        "placement": translate("Steps", "One of the ball's places: the more they differ, the better."),
        "scale": translate("Steps", "The bar that gives the scale, turned another way for every pose."),
        "calibrate": translate("Steps", "Compute the cameras from what was captured."),
        "results": translate("Steps", "Is the calibration good, and what would make it better?"),
        "verify": translate("Steps", "Does it measure right? Measure the check bar and compare with its certificate."),
        "save": translate("Steps", "Write the report and put the calibration to use."),
        "check": translate("Steps", "Has a camera moved since the calibration? One placement of the ball shows it."),
        "measure": translate("Steps", "Carry a bar through the volume, or choose points and read their distance."),
    }[step.kind]


def status_word(status: Status, kind: StepKind | None = None) -> str:
    """The state in a word; of a placement that is not there yet that it is not. `kind` None: of any step."""
    if status is Status.READY and kind in ("placement", "scale"):
        return translate("Steps", "not captured")
    return {
        Status.BLOCKED: translate("Steps", "not yet"),
        Status.READY: translate("Steps", "ready"),
        Status.RUNNING: translate("Steps", "running"),
        Status.DONE: translate("Steps", "done"),
        Status.CARE: translate("Steps", "with care"),
        Status.STALE: translate("Steps", "out of date"),
        Status.FAILED: translate("Steps", "problem"),
    }[status]


def input_name(name: str) -> str:
    """What an input of a computation is called."""
    return {
        "artefacts": translate("Steps", "the bench"),
        "calibration": translate("Steps", "the calibration"),
        "repairs": translate("Steps", "what is left out or mended"),
        "masks": translate("Steps", "the masked parts of images"),
        "limit": translate("Steps", "the limit"),
        "moved": translate("Steps", "cameras that were moved"),
        "verification": translate("Steps", "the verification"),
    }.get(name, name)


def reason_text(reason: Reason | None) -> str:
    """Why a step is blocked, stale or failed: one plain sentence."""
    if reason is None:
        return ""
    values = tuple(input_name(value) for value in reason.values)
    joined = languages.listed(values)
    texts = {
        "connect first": translate("Reasons", "The cameras are not connected."),
        "confirm the bench": translate("Reasons", "Nobody has confirmed yet which ball and bars are on the bench."),
        "look first": translate("Reasons", "Look at the cameras' images first."),
        "cameras new": translate("Reasons", "New since the last look: {names}.").format(names=joined),
        "scale missing": translate("Reasons", "No pose of the bar that gives the scale is captured."),
        "changed": translate("Reasons", "Changed since: {names}.").format(names=joined),
        "calibrate first": translate("Reasons", "There is no calibration yet."),
        "calibration stale": translate("Reasons", "The calibration is out of date: calibrate again."),
        "no check bar": translate("Reasons", "No check bar was chosen at Connect, so there is nothing to verify with."),
        "placement missing": translate("Reasons", "The ball is not captured yet."),
        "recalibrate": translate("Reasons", "The rig has changed: recalibrate it."),
        "not valid": translate("Reasons", "The calibration is not valid: see its findings."),
        "inconsistent": translate("Reasons", "The check bar contradicts the calibration."),
        "no data": translate("Reasons", "The check bar could not be measured."),
        "busy": translate("Reasons", "Work is running; wait for it or cancel it."),
        "cameras lost": translate("Reasons", "No images from {names}: check cable, power and network.").format(
            names=joined
        ),
        "moved": moved_text(values),
        "taken without": translate("Reasons", "Captured without {names}: retake it.").format(names=joined),
        "taken moving": translate("Reasons", "The scene moved in {names}: retake it.").format(names=joined),
        "moved since": translate("Reasons", "{names} was moved after this: retake it.").format(names=joined),
        "repair not in use": translate("Reasons", "Repaired, but not in use yet."),
        "with care": translate("Reasons", "To be used with care: see the findings."),
        "not verified": translate("Reasons", "Saved, but not verified."),
        "undecided": translate("Reasons", "Undecided: uncertainty too large for the limit."),
        "watch": translate("Reasons", "The rig has changed a little: watch it."),
        "error": joined,
        "project gone": translate(
            "Reasons", "The project's folder {folder} is gone. Put it back, or begin anew on the start page."
        ).format(folder=joined),
    }
    if reason.code == "placements missing":
        text = translate("Reasons", "{have} of at least {need} placements are captured.")
        return text.format(have=reason.values[0], need=reason.values[1])
    if reason.code == "flawed":
        text = translate("Reasons", "{name} is not good ({cameras}): retake it, or keep it as it is.")
        return text.format(name=values[0], cameras=languages.listed(values[1:]))
    return texts[reason.code]


def moved_text(cameras: tuple[str, ...], here: bool = True) -> str:
    """That cameras were moved, and what to do; `here`: the page has the button."""
    text = translate("Reasons", "{names} was moved. Tighten its mount, then press “Fixed again”.")
    if not here:
        text = translate("Reasons", "{names} was moved. Tighten its mount, then press “Fixed again” at Camera check.")
    return text.format(names=languages.listed(cameras))


def camera_trouble(status: "CameraStatus") -> str:
    """What is wrong with a camera and what to do, by its state; the engine's own words are `camera_details`."""
    return {
        "found": translate("Cameras", "Found, but not opened. Search again."),
        "no trigger": translate("Cameras", "It waits for a trigger. Check trigger, cable and network load."),
        "incomplete frames": translate(
            "Cameras", "Images arrive with parts missing. Check cable, switch, packet size."
        ),
        "lost": translate("Cameras", "Lost. Check cable, power and network; it comes back by itself."),
        "busy": translate("Cameras", "Another program is using it. Close that program."),
        "error": translate("Cameras", "It cannot be opened. Switch it off and on, then search again."),
    }.get(status.state.value, camera_details(status))


def camera_details(status: "CameraStatus") -> str:
    """The engine's own words on a camera, which are English."""
    return f"{status.state.value}. {status.cause} {status.remedy}".strip()


def verdict_word(verdict: str) -> str:
    """A verdict of the engine, for people."""
    return {
        "valid": translate("Verdicts", "valid"),
        "use with care": translate("Verdicts", "use with care"),
        "not valid": translate("Verdicts", "not valid"),
        "consistent": translate("Verdicts", "consistent"),
        "pass": translate("Verdicts", "within the limit"),
        "undecided": translate("Verdicts", "undecided"),
        "inconsistent": translate("Verdicts", "inconsistent"),
        "no data": translate("Verdicts", "no data"),
        "ok": translate("Verdicts", "OK"),
        "watch": translate("Verdicts", "watch"),
        "recalibrate": translate("Verdicts", "recalibrate"),
    }.get(verdict, verdict)


def error_text(error: BaseException) -> tuple[str, str]:
    """What happened and what to do, for people; bugs say that they are ours."""
    if isinstance(error, SpherecalError):
        return error.words(languages.now())
    if isinstance(error, OSError) and error.strerror:
        file = error.filename or Phrase("error-the-disk")
        what = Phrase("error-cannot-write", {"file": file, "why": reason(error)})
        return OutputError(what, Phrase("error-free-disk-again")).words(languages.now())
    what = translate("Errors", "Something went wrong inside the program ({kind}: {text}).")
    hint = translate("Errors", "What was recorded is safe. Try again; if it happens again, send the log to us.")
    return what.format(kind=type(error).__name__, text=error), hint


def error_line(error: BaseException) -> str:
    """What happened and what to do in one line, in the interface's language as far as the error is one of ours."""
    return " ".join(error.words(languages.now())).strip() if isinstance(error, SpherecalError) else str(error)
