"""The report of a result folder: its pages, its bytes, and what it refuses."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image, ImageDraw
from pypdf import PdfReader

from spherecal.base.errors import InputError, OutputError
from spherecal.data.rig import Quality, Rig, RigScale
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.main import main
from spherecal_documents.report.detections import choose_detections, find_session, read_grey
from spherecal_documents.report.model import Figure, Panels, as_plain
from spherecal_documents.report.rig_drawing import ScenePicture
from spherecal_documents.report.rig_view import make_scene
from spherecal_documents.report.style import number, report_style, shortened, significant, text_width
from spherecal_documents.report.write_report import make_report, report_bytes, write_report
from spherecal_files.findings_file import as_written
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig, rig_bytes
from spherecal_files.write_result import POINT_COLUMNS, RESIDUAL_COLUMNS, SPHERE_COLUMNS
from spherecal_rigs.result_folder import read_result
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions

IMAGES = (("P1", "C01", 8), ("P1", "C08", 16), ("P2", "C02", 8))
# The rig in space as OpenGL would render it.
PICTURE = ScenePicture(
    np.full((88, 160, 3), (10, 120, 200), np.uint8),
    ("C01", "P1", "x"),
    np.array([[20.0, 20.0], [80.0, 40.0], [90.0, 60.0]]),
    250.0,
)


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    """A simulated rig with some images, calibrated and verified: folders `session` and `result`."""
    folder = tmp_path_factory.mktemp("demo")
    session, result = str(folder / "session"), str(folder / "result")
    write_session(*simulate_session("rigA", 1, SimulationOptions(targets=50)), folder / "session")
    draw_images(folder / "session")
    assert main(["calibrate", session, "-o", result]) == DONE
    assert main(["verify", session, "--rig", f"{result}/rig.json", "-o", result]) == DONE
    return folder


def draw_images(folder: Path) -> None:
    """Images with a disc at each observation."""
    o = read_session(folder).observations
    assert o is not None
    document = json.loads((folder / "session.json").read_text())
    for placement, camera, bits in IMAGES:
        width, height = next(c["image_size"] for c in document["cameras"] if c["id"] == camera)
        image = Image.new("L", (width, height), 30)
        draw = ImageDraw.Draw(image)
        seen = (o.placement == o.placements.index(placement)) & (o.camera == o.cameras.index(camera))
        for u, v in o.uv[seen]:
            draw.ellipse([u - 4, v - 4, u + 4, v + 4], fill=220)
        values = np.asarray(image)
        name = f"{placement}-{camera}.png"
        Image.fromarray(values if bits == 8 else values.astype(np.uint16) * 16).save(folder / name)
        next(p for p in document["placements"] if p["id"] == placement).setdefault("images", {})[camera] = name
    (folder / "session.json").write_text(json.dumps(document))


@pytest.fixture(scope="module")
def demo_pdf(demo) -> bytes:
    """The demo's report, with a rendered scene."""
    return report_bytes(".pdf", demo / "result", render=lambda *_: PICTURE)


@pytest.fixture(scope="module")
def demo_pages(demo) -> list[str]:
    """The words on each page of the demo's report, the rig in space drawn."""
    return page_texts(demo / "result")


@pytest.fixture
def result(demo, tmp_path) -> Path:
    """A copy of the demo's result to spoil."""
    return Path(shutil.copytree(demo / "result", tmp_path / "copy" / "result"))


def page_texts(folder: Path) -> list[str]:
    """The words on each page."""
    return pdf_texts(report_bytes(".pdf", folder))


def pdf_texts(pdf: bytes) -> list[str]:
    """The words on each page of a PDF, one space between them."""
    pages = PdfReader(io.BytesIO(pdf)).pages
    return [" ".join(page.extract_text().replace("\u200b", "").split()) for page in pages]


def image_counts(pdf: bytes) -> list[int]:
    """How many raster images each page has."""
    return [len(page.images) for page in PdfReader(io.BytesIO(pdf)).pages]


def write_empty_result(folder: Path, rig: Rig) -> None:
    folder.mkdir(parents=True)
    (folder / "rig.json").write_bytes(rig_bytes(rig))
    columns = {"points": POINT_COLUMNS, "residuals": RESIDUAL_COLUMNS, "spheres": SPHERE_COLUMNS}
    for name, header in columns.items():
        (folder / f"{name}.csv").write_text(header + "\n")


@pytest.fixture
def empty(tmp_path) -> Path:
    """The result of a calibration that could not place any camera."""
    rig = Rig(None, (), RigScale("none", None), Quality(False, None, None, None, ()), "")
    write_empty_result(tmp_path / "empty", rig)
    return tmp_path / "empty"


# --- what the pages say ----------------------------------------------------------------------------------------------


def test_demo_report_says_what_matters(demo, demo_pages):
    pages = demo_pages
    rig = read_rig(demo / "result" / "rig.json")
    assert "VALID" in pages[0]
    assert "NOT VALID" not in pages[0]
    assert "CONSISTENT" in pages[0]
    assert rig.input_sha256 in pages[0]
    assert f"{rig.quality.rms_px:.4f}" in pages[0]
    assert all(finding.message[:40] in pages[0] for finding in rig.quality.findings)
    cameras = pages[1]
    order = sorted(rig.cameras, key=lambda camera: -(camera.rms_px or 0))
    places = [cameras.index(f"{camera.id} ") for camera in order]
    assert places == sorted(places)
    text = " ".join(pages)
    for words in ("Top view", "Front view", "Side view", "Oblique view", "magnified", "A1\u2013A4", "Detection: C"):
        assert words in text


def test_a_rendered_scene_is_shown_with_names_in_place_of_the_oblique_view(demo, tmp_path):
    with_it, without = tmp_path / "with.html", tmp_path / "without.html"
    write_report(demo / "result", with_it, render=lambda *_: PICTURE)
    write_report(demo / "result", without)
    shown, drawn = with_it.read_text(encoding="utf-8"), without.read_text(encoding="utf-8")
    assert shown.count("data:image/png") == drawn.count("data:image/png") + 1
    assert "Oblique view" in drawn and "Oblique view" not in shown and "Top view" in shown
    assert "grid of 250 mm" in shown and ">P1<" in shown


def end_at_once(_pipe: Connection) -> None:
    os._exit(1)  # as VTK does where OpenGL is broken


def test_the_command_shows_the_rendered_scene_where_it_can(demo, tmp_path, monkeypatch, capfd):
    pytest.importorskip("pyvista", reason="pyvista is not installed")

    def written(name: str) -> str:
        assert main(["report", str(demo / "result"), "-o", str(tmp_path / name), "-q"]) == DONE
        return (tmp_path / name).read_text(encoding="utf-8")

    monkeypatch.setenv("SPHERECAL_3D", "painted")
    drawn = written("drawn.html")
    monkeypatch.delenv("SPHERECAL_3D")
    rendered = written("rendered.html")
    monkeypatch.setattr("spherecal_documents.scene.renderer.serve", end_at_once)
    ended = written("ended.html")
    assert ended == drawn
    if rendered == drawn:
        pytest.skip("OpenGL does not work here")
    assert rendered.count("data:image/png") == drawn.count("data:image/png") + 1 and "Oblique view" not in rendered
    assert capfd.readouterr().err == "", "VTK says nothing"


def test_pdf_is_vector_whole_and_the_same_each_time(demo, demo_pdf, demo_pages, tmp_path):
    output = tmp_path / "report.pdf"
    write_report(demo / "result", output, render=lambda *_: PICTURE)
    data = output.read_bytes()
    assert data.startswith(b"%PDF-")
    assert data.rstrip().endswith(b"%%EOF")
    assert "/CreationDate" not in (PdfReader(io.BytesIO(data)).metadata or {})
    assert data == demo_pdf
    images = image_counts(data)
    assert len(images) == len(demo_pages)
    # two pictures with a detail each, the bar of colours, the rendered scene
    assert sum(images) == 2 * 2 + 1 + 1
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]


def test_text_can_be_extracted(demo_pdf):
    text = " ".join(pdf_texts(demo_pdf))
    for words in ("Calibration report", "VALID", "sd", "Page 1 of", "C10", "length error / mm"):
        assert words in text


def test_a_report_of_training_says_so_on_every_page_and_holds_the_operators_note(empty, tmp_path):
    said = partial(report_bytes, notice="SIMULATED: not real", note="Maria, after the bump #panic() *b* $x$")
    pages = pdf_texts(said(".pdf", empty))
    assert pages and all("SIMULATED: not real" in page for page in pages)
    assert "Maria, after the bump #panic() *b* $x$" in pages[0], "no text is markup"
    page = said(".html", empty).decode()
    assert "SIMULATED: not real" in page and "Maria, after the bump" in page


@pytest.mark.parametrize(("page", "size"), [("A4", (595.3, 841.9)), ("Letter", (612.0, 792.0))])
def test_page_sizes(empty, page, size):
    box = PdfReader(io.BytesIO(report_bytes(".pdf", empty, page=page))).pages[0].mediabox
    assert (float(box.width), float(box.height)) == pytest.approx(size, abs=0.1)


@pytest.mark.slow
def test_real_recording(shared_data, tmp_path):
    assert main(["calibrate", str(shared_data / "dome15"), "-o", str(tmp_path / "result")]) == DONE
    pages = page_texts(tmp_path / "result")
    text = " ".join(pages)
    assert "NOT DONE" in text
    assert "C01 and 14 more" in text  # one lens for all in this recording
    assert len(pages) >= 4


def test_empty_result(empty, tmp_path):
    pages = page_texts(empty)
    assert "NOT VALID" in pages[0]
    assert "No camera is placed" in pages[0]
    assert "No camera could be placed" in " ".join(pages) and "Signature" in pages[-1]


def test_letters_the_font_lacks_and_its_subsetting_stay_quiet(tmp_path, caplog, recwarn):
    caplog.set_level("INFO")
    finding = as_written("error", "unlinked", "\u76f8\u673a C01 \u03a9", "", ("C01",))
    rig = Rig(None, (), RigScale("none", None), Quality(False, None, None, None, (finding,)), "")
    write_empty_result(tmp_path / "result", rig)
    pages = page_texts(tmp_path / "result")
    assert "\u03a9" in pages[0] and "C01" in pages[0]
    assert not caplog.records
    assert not recwarn.list


def test_when_the_images_were_taken(empty):
    assert "not noted with the recording" in " ".join(page_texts(empty))
    rig = json.loads((empty / "rig.json").read_text())
    (empty / "rig.json").write_text(json.dumps(rig | {"recorded_at": "2026-03-05T08:59:30+01:00"}))
    assert read_rig(empty / "rig.json").recorded_at == datetime(2026, 3, 5, 7, 59, 30, tzinfo=UTC)
    assert "2026-03-05 07:59 UTC" in " ".join(page_texts(empty))
    assert b"2026-03-05 07:59 UTC" in report_bytes(".html", empty)


def test_failed_verification(result):
    lines = (result / "bars.csv").read_text().splitlines()
    cells = lines[1].split(",")
    cells[4], cells[6] = str(float(cells[4]) + 0.5), "0.5"
    (result / "bars.csv").write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]) + "\n")
    document = json.loads((result / "verification.json").read_text())
    document["decision"]["verdict"] = "inconsistent"
    document["decision"]["exceeding"] = [{"pose": cells[1], "from": cells[2], "to": cells[3]}]
    (result / "verification.json").write_text(json.dumps(document))
    pages = page_texts(result)
    assert "INCONSISTENT" in pages[0]
    assert "1 of 48 lengths differ" in pages[0]


def test_many_cameras_with_odd_names(demo, tmp_path):
    rig = read_rig(demo / "result" / "rig.json")
    names = [f"_C{i}_-.{'x' * (i % 50)}" for i in range(60)]  # ids become file names
    cameras = tuple(
        replace(rig.cameras[i % 10], id=name, translation_mm=rig.cameras[i % 10].translation_mm + 30.0 * i, sigma=None)
        for i, name in enumerate(names)
    )
    write_empty_result(tmp_path / "result", replace(rig, cameras=cameras, reference_camera=names[3]))
    shutil.copy(demo / "result" / "points.csv", tmp_path / "result")
    rows = [line.split(",") for line in (demo / "result" / "residuals.csv").read_text().splitlines()]
    rows[1:] = [[row[0], names[i % 60], *row[2:]] for i, row in enumerate(rows[1:])]
    (tmp_path / "result" / "residuals.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    pdf = report_bytes(".pdf", tmp_path / "result")
    text = "".join(pdf_texts(pdf)).replace(" ", "")
    assert all(name in text for name in names), "long names are broken over lines, not cut"
    images = image_counts(pdf)
    assert len(images) > 6
    assert sum(images) == 1, "the bar of colours: the rig in space is drawn"


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rig.json", "points.csv", "residuals.csv", "spheres.csv", "bars.csv"])
def test_missing_file_is_named(result, name):
    (result / name).unlink()
    with pytest.raises(InputError, match=re.escape(name)):
        report_bytes(".pdf", result)


BROKEN = [
    ("rig.json", "{", "not valid JSON"),
    ("verification.json", "[]", "must be an object|is not a"),
    ("points.csv", "placement\n", "line 1 must be"),
    ("points.csv", POINT_COLUMNS + "\nP1,1,A,0,0\n", "line 2 has 5 fields"),
    ("points.csv", POINT_COLUMNS + "\nP1,1,A,0,,0,,,,2\n", "column y_mm"),
    ("points.csv", POINT_COLUMNS + "\nP1,1.5,A,0,0,0,,,,2\n", "whole number"),
    ("points.csv", POINT_COLUMNS + "\nP1,1,A,0,0,0,-1,,,2\n", "negative"),
    ("residuals.csv", RESIDUAL_COLUMNS + "\nP1,C01,1,A,nan,0,1\n", "finite number"),
    ("residuals.csv", RESIDUAL_COLUMNS + "\nP1,C01,1,A,0,0,2\n", "neither 0 nor 1"),
    ("residuals.csv", RESIDUAL_COLUMNS + "\nP1,C01,1,A,,,1\n", "without a residual"),
    ("residuals.csv", RESIDUAL_COLUMNS + "\n,C01,1,A,,,0\n", "column placement"),
    ("residuals.csv", RESIDUAL_COLUMNS + "\n\nP1,C01,1,A,,,0\n", "line 2 is empty"),
    ("spheres.csv", SPHERE_COLUMNS + "\nP1,0,0,0,big,0\n", "column radius_mm"),
    ("bars.csv", "\xff", "line 1"),
]


@pytest.mark.parametrize(("name", "text", "complaint"), BROKEN)
def test_broken_file_is_named(result, tmp_path, name, text, complaint):
    (result / name).write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=f"{re.escape(name)}.*({complaint})"):
        write_report(result, tmp_path / "report.pdf")
    assert not (tmp_path / "report.pdf").exists()


def test_no_folder_and_no_place(empty, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        report_bytes(".pdf", tmp_path / "nowhere")
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(empty, tmp_path / "nowhere" / "report.pdf")
    with pytest.raises(InputError, match="A3"):
        report_bytes(".pdf", empty, page="A3")  # pyright: ignore[reportArgumentType]


# --- detections and pictures -----------------------------------------------------------------------------------------


def test_observations_lie_on_the_images_dots(demo):
    result = read_result(demo / "result")
    detections = choose_detections(result, find_session(result, demo / "session"))
    assert len(detections) == 2
    assert len({d.camera for d in detections}) == len({d.placement for d in detections}) == 2
    for detection in detections:
        image = read_grey(detection.path)
        u, v = np.round(detection.uv).astype(int).T
        assert (image[v, u] > 200).all()


def test_another_session_is_refused_if_named_and_ignored_if_guessed(demo, result):
    other = shutil.copytree(demo / "session", result.parent / "session")
    document = json.loads((other / "session.json").read_text())
    document["sphere"]["nominal_diameter_mm"] = 501.0
    (other / "session.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="is not the session"):
        report_bytes(".pdf", result, other)
    assert not any("Detection" in page for page in page_texts(result))


def test_unreadable_image_is_named(tmp_path):
    (tmp_path / "image.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    with pytest.raises(InputError, match=r"image\.png: cannot be read"):
        read_grey(tmp_path / "image.png")


def test_what_an_image_shows_stays_on_one_page(demo, demo_pages):
    read = read_result(demo / "result")
    report = make_report(read, find_session(read, None))
    sections = [section for section in report.sections if section.key == "detection"]
    assert len(sections) == 2
    for section in sections:
        assert len([page for page in demo_pages if section.title in page]) == 1
        whole, detail = (block for block in section.blocks if isinstance(block, Figure))
        assert whole.height + detail.height < 220.0
        assert detail.width > 170.0


def test_drawings_leave_the_settings_alone_and_are_the_same_each_time(demo):
    read = read_result(demo / "result")
    before = dict(matplotlib.rcParams)
    with report_style():
        first, again = (as_plain(make_report(read)) for _ in range(2))
    assert dict(matplotlib.rcParams) == before
    assert first == again
    report = make_report(read)
    drawn = [*report.blocks(Figure), *(one for panels in report.blocks(Panels) for one in panels.figures)]
    assert len(drawn) >= 2 + 2 + len(read.rig.cameras) + 2
    with report_style():
        for figure in drawn:
            assert figure.svg().count("<path") >= 3, figure.name


# --- parts -----------------------------------------------------------------------------------------------------------


def test_views_have_a_sensible_height(demo):
    scene = make_scene(read_result(demo / "result"))
    np.testing.assert_allclose(scene.axes @ scene.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(scene.axes) > 0
    targets = np.vstack([placement.targets for placement in scene.placements])
    heights = [camera.centre[2] for camera in scene.cameras]
    assert min(heights) > targets[:, 2].max()  # the cameras of this rig look down on the balls


def test_cameras_all_around_stand_upright(demo):
    """A ring of cameras that look inwards with level images: the height is the ring's axis, upwards."""
    result = read_result(demo / "result")
    cameras = []
    for i in range(8):
        angle = np.pi / 4 * i
        forward, down = np.array([-np.cos(angle), -np.sin(angle), 0.0]), np.array([0.0, 0.0, -1.0])
        rotation = np.vstack([np.cross(down, forward), down, forward])
        cameras.append(replace(result.rig.cameras[i], rotation=rotation, translation_mm=np.array([0.0, 0.0, 1000.0])))
    rig = replace(result.rig, cameras=tuple(cameras), reference_camera=None)
    np.testing.assert_allclose(make_scene(replace(result, rig=rig)).axes[2], [0, 0, 1], atol=1e-9)


def test_shortened_text_keeps_within_the_width():
    text = "Some words and aVeryLongWordWithoutAnyPlaceToBreakIt and more words"
    with report_style():
        assert 27.0 < text_width(shortened(text, 30.0, 8.0), 8.0) <= 30.0
        assert shortened("short", 30.0, 8.0) == "short"


def test_numbers():
    assert number(-0.00001, 3, sign=True) == "0.000"
    assert number(-1.5, 1) == "\u22121.5"
    assert number(float("nan"), 1) == number(None, 1) == "\u2013"
    assert significant(0.031415) == "0.031"
    assert significant(123.4) == "123"


def test_start_up_stays_light():
    code = (
        "import sys, spherecal_app.cli.main, spherecal_app.cli.calibrate_command\n"
        "assert 'matplotlib' not in sys.modules\n"
        "import spherecal_documents.report.write_report\n"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0
