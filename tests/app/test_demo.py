"""From rendered images to the verified rig and its report, as `spherecal demo` runs it."""

import csv
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.detect.redetection import Located, with_missed_targets
from spherecal.detect.session_images import observed
from spherecal_app.cli.main import main
from spherecal_files.read_session import read_session
from spherecal_sim.render_session import demo_session


@pytest.fixture(scope="module")
def said(demo_tried: Path) -> tuple[Path, list[str]]:
    """The demo's output, result and report, and the lines that it printed."""
    return demo_tried / "try", (demo_tried / "printed.txt").read_text(encoding="utf-8").splitlines()


@pytest.fixture(scope="module")
def folder(said: tuple[Path, list[str]]) -> Path:
    return said[0]


@pytest.fixture(scope="module")
def session() -> Session:
    """The demo's session with the observations found in its images."""
    return observed(read_session(demo_session()), Context())


@pytest.fixture(scope="module")
def first(session: Session) -> Calibration:
    return calibrate(session)


def true_dots() -> dict[tuple[str, str, int, str], tuple[float, float, float]]:
    """Rim centre (u, v) and view angle of every dot in every image."""
    with (demo_session() / "truth_dots.csv").open(encoding="utf-8") as file:
        return {
            (r["placement"], r["camera"], int(r["target"]), r["point"]): (
                float(r["u_rim"]),
                float(r["v_rim"]),
                float(r["view_deg"]),
            )
            for r in csv.DictReader(file)
        }


def test_demo_says_in_five_lines_what_it_found(said: tuple[Path, list[str]]) -> None:
    folder, lines = said
    found = lines[1:]
    assert len(found) == 5
    assert found[0].startswith("VALID: 6 cameras placed, rms 0.01")
    assert found[1].startswith("Cameras: standard deviation of their centres at most 0.0")
    assert found[2].startswith("Ball: radius 2")
    assert found[3].startswith("CONSISTENT: 6 lengths of a bar, largest error 0.00")
    assert str(folder) in found[4] and "--verbose" in found[4]


def test_demo_without_matplotlib_leaves_out_the_report_and_says_so(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Calibrated and verified was the same before: the result of the demo with a report."""
    ran: list[str] = []

    def step(line: list[str]) -> int:
        ran.append(line[0])
        if line[0] == "calibrate":
            shutil.copytree(folder / "result", line[line.index("-o") + 1])
        return 0

    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # as Python itself marks a package that cannot be imported
    monkeypatch.setattr("spherecal_app.cli.demo.main", step)
    assert main(["demo", "-o", str(tmp_path)]) == 0
    assert ran == ["calibrate", "verify"]
    found = capsys.readouterr().out.splitlines()[1:]
    assert [line.split()[0] for line in found] == ["VALID:", "Cameras:", "Ball:", "CONSISTENT:", "The", "Result"]
    assert found[4].endswith("needs matplotlib and typst: pip install matplotlib typst")
    assert not (tmp_path / "report.pdf").exists()


def test_demo_calibrates_verifies_and_reports(folder: Path) -> None:
    rig = json.loads((folder / "result" / "rig.json").read_text(encoding="utf-8"))
    assert rig["quality"]["valid"]
    assert [camera["id"] for camera in rig["cameras"]] == [f"C0{i}" for i in range(1, 7)]
    assert rig["quality"]["rms_px"] < 0.02
    assert rig["quality"]["sigma0"] == pytest.approx(1.0, abs=0.2)  # the detector's sigmas are real
    verification = json.loads((folder / "result" / "verification.json").read_text(encoding="utf-8"))
    assert verification["decision"]["verdict"] == "consistent"
    assert abs(verification["overall"]["mean_error_mm"]) < 0.03
    assert verification["overall"]["sd_mm"] < 0.06
    assert (folder / "result" / "observations.csv").stat().st_size > 100_000
    assert (folder / "report.pdf").read_bytes().startswith(b"%PDF")


def test_no_wrong_identity_and_honest_sigmas_in_all_images(session: Session) -> None:
    o, truth = session.observations, true_dots()
    assert o is not None and o.sigma is not None
    keys = [
        (o.placements[p], o.cameras[c], int(t), o.points[d])
        for p, c, t, d in zip(o.placement, o.camera, o.target, o.point, strict=True)
    ]
    assert all(key in truth for key in keys)
    true = np.array([truth[key] for key in keys])
    error = o.uv - true[:, :2]
    assert np.linalg.norm(error, axis=1).max() < 3.0  # no dot taken for its neighbour, a dot's pitch away
    square_on = true[:, 2] < 55
    size = np.sort(np.linalg.norm(error[square_on], axis=1))
    assert np.sqrt((size[: int(0.98 * len(size))] ** 2).mean()) < 0.012
    assert 0.8 < np.std((error / o.sigma)[square_on]) < 1.3


def test_redetection_finds_what_detection_missed(session: Session, first: Calibration) -> None:
    o = session.observations
    assert o is not None
    at = (o.placement == 1) & (o.camera == 2)
    ids = np.unique(o.target[at])
    missed = ids[:: max(1, len(ids) // 8)]
    lost = at & np.isin(o.target, missed)
    without = replace(session, observations=o.select(~lost))
    again = with_missed_targets(without, Located.of(first), Context()).observations
    assert again is not None
    new = np.arange(len(again)) >= int((~lost).sum())
    found = new & (again.placement == 1) & (again.camera == 2)
    assert set(missed) <= set(again.target[found])
    truth = true_dots()
    for i in np.flatnonzero(new):
        key = (
            again.placements[again.placement[i]],
            again.cameras[again.camera[i]],
            int(again.target[i]),
            again.points[again.point[i]],
        )
        assert np.hypot(*(again.uv[i] - truth[key][:2])) < 0.3


def test_redetection_sees_no_target_that_is_covered(session: Session, first: Calibration, tmp_path: Path) -> None:
    o = session.observations
    assert o is not None
    at = np.flatnonzero((o.placement == 0) & (o.camera == 0))
    path = session.placements[0].images[session.cameras[0].id]
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    covered = np.unique(o.target[at])[:5]
    for target in covered:
        u, v = o.uv[at[o.target[at] == target]].mean(axis=0).astype(int)
        cv2.circle(image, (int(u), int(v)), 60, 70, -1)
    cv2.imwrite(str(tmp_path / "covered.png"), image)
    images = {**session.placements[0].images, session.cameras[0].id: tmp_path / "covered.png"}
    hidden = np.zeros(len(o), dtype=bool)
    hidden[at] = np.isin(o.target[at], covered)
    placements = (replace(session.placements[0], images=images), *session.placements[1:])
    again = with_missed_targets(
        replace(session, observations=o.select(~hidden), placements=placements), Located.of(first), Context()
    ).observations
    assert again is not None
    new = np.arange(len(again)) >= int((~hidden).sum())
    back = new & (again.placement == 0) & (again.camera == 0) & np.isin(again.target, covered)
    assert not back.any()


def test_image_of_another_size_is_refused(session: Session, tmp_path: Path) -> None:
    camera = session.cameras[0].id
    image = cv2.imread(str(session.placements[0].images[camera]), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "small.png"), image[:-10])
    images = {**session.placements[0].images, camera: tmp_path / "small.png"}
    placements = (replace(session.placements[0], images=images), *session.placements[1:])
    with pytest.raises(InputError, match=r"small\.png has .* pixels"):
        observed(replace(session, observations=None, placements=placements), Context())


def test_detect_command(tmp_path: Path, session: Session) -> None:
    path = session.placements[0].images[session.cameras[0].id]
    targets = demo_session() / "targets.json"
    table = tmp_path / "dots.csv"
    assert main(["detect", str(path), "--targets", str(targets), "--csv", str(table)]) == 0
    rows = list(csv.DictReader(table.open(encoding="utf-8")))
    assert rows[0].keys() == {"image", "target", "point", "u", "v"}
    assert {row["image"] for row in rows} == {str(path)}
    o = session.observations
    assert o is not None
    assert len(rows) == int(((o.placement == 0) & (o.camera == 0)).sum())

    empty = tmp_path / "empty.png"
    cv2.imwrite(str(empty), np.full((400, 500), 80, np.uint8))
    assert main(["detect", str(empty), "--targets", str(targets), "--csv", str(table)]) == 0
    assert table.read_text(encoding="utf-8") == "image,target,point,u,v\n"

    table.unlink()
    (tmp_path / "broken.png").write_bytes(path.read_bytes()[:1000])
    assert main(["detect", str(tmp_path / "broken.png"), "--targets", str(targets), "--csv", str(table)]) == 2
    assert not table.exists()
