"""What a calibration by a board or a bar says about itself."""

import numpy as np

from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, IntArray
from spherecal.baselines.result import Fit, groups_of
from spherecal.diagnose.soundness import MANY_OUTLIERS
from spherecal.findings import Finding, counted
from spherecal.judge import LITTLE_COVERAGE, STATED_LENGTH_MM, WEAK_FOCAL_SD, image_coverage
from spherecal.session.model import Session


def unlinked(
    camera_ids: tuple[str, ...], linked: IntArray, placed: BoolArray, shared: str, hint: str
) -> list[Finding]:  # fmt: skip
    """Cameras that could not be linked, group by group; `shared` says in words what two linked cameras share."""
    if placed.all():
        return []
    ids = np.array(camera_ids)
    groups = groups_of(np.where(placed[:, None] == placed, linked, 0) + np.outer(placed, placed), placed)
    names = " | ".join(" ".join(ids[group]) for group in groups)
    message = f"{len(groups)} groups of cameras cannot be linked, as no two of them share {shared}: {names}."
    if not placed.any():
        message = f"None of the cameras could be placed: {names}."
    return [
        Finding("error", "cameras-unlinked", message, hint, tuple(str(name) for group in groups for name in ids[group]))
    ]


def common_findings(session: Session, fit: Fit, what: str) -> list[Finding]:
    """Findings that boards and bars share; `what` was shown to the cameras."""
    return [
        *_convergence(fit, what),
        *_held(session, fit, what),
        *_weak(session, fit, what),
        *_coverage(session, fit, what),
        *_outliers(session, fit),
    ]


def scale_finding(source: str, relative: float, certified: bool) -> Finding:
    """How good the scale is, in millimetres on a length that a user can picture."""
    message = (
        f"The scale comes from the {source}; its standard uncertainty is {relative * STATED_LENGTH_MM:.3f} mm on "
        f"{STATED_LENGTH_MM:.0f} mm"
    )
    if certified:
        return Finding("info", "scale-uncertainty", message + ", its certificate included.", "")
    return Finding(
        "warning", "scale-uncertainty", message + f", without what the {source} itself is off.",
        'State its relative standard uncertainty in session.json ("relative_uncertainty" of "board").',
    )  # fmt: skip


def _convergence(fit: Fit, what: str) -> list[Finding]:
    found = []
    if not fit.converged:
        found.append(
            Finding(
                "error", "not-converged", "The joint adjustment did not converge.",
                f"The start was too far off or the geometry too weak: check the focal lengths and show the {what} in "
                "more places and tilts.",
            )
        )  # fmt: skip
    if fit.covariance is None:
        found.append(
            Finding(
                "error", "degenerate-geometry",
                "The observations do not determine the network: its normal equations are singular.",
                f"Show the {what} in different depths and tilts to every camera.",
            )
        )  # fmt: skip
    return found


def _held(session: Session, fit: Fit, what: str) -> list[Finding]:
    ids = tuple(session.cameras[c].id for c in np.flatnonzero(fit.held & fit.placed))
    if not ids:
        return []
    return [
        Finding(
            "warning", "intrinsics-held",
            f"The data cannot carry the intrinsics of {', '.join(ids)}: they are held near their nominal values.",
            f"Show the {what} to these cameras more often, tilted, and in all parts of their image.", ids,
        )
    ]  # fmt: skip


def _weak(session: Session, fit: Fit, what: str) -> list[Finding]:
    columns = fit.problem.intrinsic_columns
    if fit.covariance is None or not len(columns) or columns[0] != 0:
        return []
    cofactors = np.maximum(fit.covariance.cameras[:, POSE, POSE], 0.0)
    sd = np.sqrt(fit.variance * cofactors) / fit.state.intrinsics[:, 0]
    weak = np.flatnonzero(fit.problem.free_intrinsics[:, 0] & fit.placed & ~fit.held & (sd > WEAK_FOCAL_SD))
    if not len(weak):
        return []
    worst = weak[np.argmax(sd[weak])]
    return [
        Finding(
            "warning", "weak-self-calibration",
            f"The focal lengths of {counted(len(weak), 'camera')} are known to no better than "
            f"{WEAK_FOCAL_SD * 1e6:.0f} ppm (worst: {session.cameras[worst].id}, {sd[worst] * 1e6:.0f} ppm).",
            f"Show the {what} in more tilts and depths, or fix calibrated intrinsics.",
            tuple(session.cameras[c].id for c in weak),
        )
    ]  # fmt: skip


def _coverage(session: Session, fit: Fit, what: str) -> list[Finding]:
    coverage = image_coverage(fit.observations, fit.used, session)
    little = np.flatnonzero(fit.placed & (coverage < LITTLE_COVERAGE))
    if not len(little):
        return []
    worst = little[np.argmin(coverage[little])]
    return [
        Finding(
            "warning", "little-coverage",
            f"{counted(len(little), 'camera')} saw the {what} in less than {100 * LITTLE_COVERAGE:.0f} % of their "
            f"image (least: {session.cameras[worst].id}, {100 * coverage[worst]:.0f} %): distortion is extrapolated in "
            "the rest.",
            f"Show the {what} where these images are still empty.", tuple(session.cameras[c].id for c in little),
        )
    ]  # fmt: skip


def _outliers(session: Session, fit: Fit) -> list[Finding]:
    candidates = np.isfinite(fit.residual[:, 0])
    out = candidates & ~fit.used
    count, share = int(out.sum()), float(out.sum() / max(candidates.sum(), 1))
    if not count:
        return []
    by_camera = np.bincount(fit.observations.camera[out], minlength=len(session.cameras))
    most = int(np.argmax(by_camera))
    return [
        Finding(
            "warning" if share > MANY_OUTLIERS else "info", "outliers-removed",
            f"{count} of {candidates.sum()} observations ({100 * share:.1f} %) contradict the others and are left out "
            f"(most in {session.cameras[most].id}: {by_camera[most]}).",
            "Some are normal: reflections, dirt, wrong codes. Look at this camera's images if there are many.",
            (session.cameras[most].id,),
        )
    ]  # fmt: skip
