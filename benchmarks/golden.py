"""All outputs of the program, to be equal before and after a change that moves code: `golden.py OUT`, `--compare A B`.

All is made through the command line, in one process. Times of day and versions are replaced in the files.
"""

import contextlib
import csv
import json
import os
import re
import runpy
import shlex
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

FORMATS = "opencv ros kalibr colmap metashape anipose caliscope mc-calib multical mrcal csv gltf ply blender".split()
PREPARED = """
simulate rigA -o s/rigA --observations-only -q; calibrate s/rigA -o rigA
simulate rigB -o s/rigB --observations-only -q; calibrate s/rigB -o rigB
simulate hall6 -o s/hall6 --observations-only -q; calibrate s/hall6 -o hall6"""
COMMANDS = """
calibrate s/unlinked -o unlinked; calibrate s/swapped -o swapped; calibrate s/moved -o moved; calibrate s/soft -o soft
calibrate s/board -o board --method board; calibrate s/bar -o bar --method bar
calibrate s/hall6 -o free --method free; calibrate s/hall6 -o tao --method tao2021 --no-spo
calibrate s/hall6 -o fixed --intrinsics fixed; calibrate s/rigB -o rational --lens rational --own-intrinsics
calibrate s/hall6 -o ball --ball hall6/ball.json --leave-out placement:P3
calibrate s/moved -o split --split C02@P4; calibrate s/moved -o unrepaired --no-repair
recalibrate s/moved --rig hall6/rig.json --only C02 --estimate pose -o again --json
verify s/hall6 --rig hall6/rig.json -o hall6 --limit 0.03+L/20000 --json
profile save free --to profile --session s/hall6 --temperature 20 --calibrated-at 2026-01-01T09:00:00+00:00 --apply --note first
profile save hall6 --to profile --session s/hall6 --temperature 20 --calibrated-at 2026-02-01T09:00:00+00:00
profile apply profile --json; profile list . --json; profile compare free hall6 --json; profile trend profile --csv t.csv
check s/hall6 --profile profile --only P5 -o check-kept.json; check s/moved --profile profile --only P5 -o check.json
check s/hall6 --profile profile --only A-01,A-02 --json; profile trend profile --checks --json
check s/moved --profile hall6 --only P4,P5 --repair check-repair --json
measure s/hall6 --rig hall6 -o series --distance 201/centre,202/centre=100.17 --angle 5/B,6/B,7/B --json
frame hall6 -o frame.json --origin P1 --x P2 --xy P3; export hall6/rig.json --to opencv -o framed.yml --frame frame.json
guide s/hall6 --json; bars plan hall6 --session s/hall6 --json
import exports/opencv --format opencv -o imported.json; targets export -o targets.json
targets sheet -o sheet.pdf --count 24; targets sheet -o board.pdf --board aprilgrid,rows=4,columns=5,pitch_mm=36,marker_mm=28
simulate demo -o s/demo; detect IMAGES --targets s/demo/targets.json --csv detected.csv --json
calibrate s/demo -o images; demo -o demo --json
calibrate DATA/dome15 -o dome15; calibrate DATA/camcal -o camcal"""
TIMES = re.compile(rb"20(?!23)\d\d-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d+)?|\d+\.\d+ s\.")
VERSION = re.compile(rb'(?i)("version": ?"|spherecal )\d+\.\d+\.\d+[^"\s,<]*')
DRAWN = {".pdf", ".html", ".png", ".svg"}
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.]*\w)")


def run(words: list[str], codes: dict[str, int]) -> None:
    """One command of the program; what it prints and its exit code are outputs too."""
    name = f"{len(codes):02d} {' '.join(words)}"
    printed = Path("printed", re.sub(r"[^\w.-]+", "_", name)[:80] + ".txt")
    with printed.open("w", encoding="utf-8") as out, contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        sys.argv = ["spherecal", *words]
        try:
            runpy.run_module("spherecal", run_name="__main__", alter_sys=True)
        except SystemExit as end:
            codes[name[:200]] = int(end.code or 0)
    lines = printed.read_text(encoding="utf-8").splitlines(keepends=True)  # of progress, as many as there was time for
    printed.write_text("".join(line for line in lines if not line.endswith("...\n")), encoding="utf-8")
    print(f"{time.process_time():.0f} s", codes[name[:200]], name[:110], flush=True)


def table(path: str) -> list[list[str]]:
    with Path(path).open(encoding="utf-8") as file:
        return list(csv.reader(file))[1:]


def session(name: str, of: str, rows: list[list[str]], change: Callable[[dict], object] = lambda _: None) -> None:
    """The session `of` under another name, with these observations, and with `change` made to its document."""
    shutil.copytree(f"s/{of}", f"s/{name}")
    with Path(f"s/{name}/observations.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([["placement", "camera", "target", "point", "u", "v"], *rows])
    file = Path(f"s/{name}/session.json")
    document = json.loads(file.read_text(encoding="utf-8"))
    change(document)
    file.write_text(json.dumps({k: v for k, v in document.items() if v is not None}), encoding="utf-8")


def seen(camera: int, points: np.ndarray, turn: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Pixels (n, 2) of points (n, 3) mm in a camera of hall6's result, the camera turned by a rotation vector."""
    one = json.loads(Path("hall6/rig.json").read_text(encoding="utf-8"))["cameras"][camera]
    matrix, rotation = np.array(one["matrix"]), cv2.Rodrigues(np.array(turn))[0] @ np.array(one["rotation"])
    shift, lens = np.array(one["translation_mm"]), np.array(one["distortion"]["coefficients"])
    return cv2.projectPoints(points, rotation, shift, matrix, lens)[0][:, 0]


def figure(points: np.ndarray, first: int, poses: list[str], spread: float) -> list[list[str]]:
    """Observations of a rigid figure (n, 3) mm in poses before the cameras of hall6, with noise of 0.05 px."""
    rng, rows = np.random.default_rng(len(poses)), []
    ball = np.array([row[1:4] for row in table("hall6/spheres.csv")], dtype=float)
    for pose in poses:
        turn = cv2.Rodrigues(rng.normal(size=3) * spread)[0]
        world = points @ turn.T + ball.mean(axis=0) + rng.uniform(-0.5, 0.5, 3) * np.ptp(ball, axis=0)
        for camera in range(6):
            uv = seen(camera, world) + rng.normal(0, 0.05, (len(points), 2))
            for n in np.flatnonzero(((uv > 0) & (uv < [2063, 1543])).all(axis=1)):
                rows.append([pose, f"C{camera + 1:02d}", first + n, "centre", *(f"{x:.6f}" for x in uv[n])])
    return rows


def edit() -> None:
    """Sessions with groups that are not linked, exchanged images, a camera that turned, a soft ball, a board, a bar."""
    parted = [r for r in table("s/rigA/observations.csv") if r[0][0] == "P" and (r[1] <= "C05") == (r[0] <= "P2")]
    session("unlinked", "rigA", parted, lambda d: d.update(bars=[], bar_poses=[]))
    rows, swap = table("s/hall6/observations.csv"), {"C02": "C03", "C03": "C02"}
    session("swapped", "hall6", [[r[0], swap.get(r[1], r[1]) if r[0] == "P4" else r[1], *r[2:]] for r in rows])
    space = {tuple(r[:3]): r[3:6] for r in table("hall6/points.csv")}
    centre = {r[0]: np.array(r[1:4], dtype=float) for r in table("hall6/spheres.csv")}
    turned, bent = [], []
    for placement, camera, target, point, *place in rows:
        xyz, uv = np.array([space.get((placement, target, point), [0, 0, 0])], dtype=float), np.array(place, dtype=float)
        moved = soft = np.zeros(2)
        if xyz.any() and placement in centre:
            index, out = int(camera[1:]) - 1, (xyz - centre[placement]) / 250
            sag = out * (out[:, [1]] ** 2 - 0.3) * np.sin(int(placement[1:])) * 0.3
            soft = seen(index, xyz + sag)[0] - seen(index, xyz)[0]
            if camera == "C02" and placement >= "P4":
                moved = seen(index, xyz, (0.004, -0.003, 0.002))[0] - seen(index, xyz)[0]
        turned.append([placement, camera, target, point, *(f"{x:.6f}" for x in uv + moved)])
        bent.append([placement, camera, target, point, *(f"{x:.6f}" for x in uv + soft)])
    session("moved", "hall6", turned)
    session("soft", "hall6", bent)
    grid = np.array([[x, y, 0] for y in range(8) for x in range(10)]) * 30.0 - [135, 105, 0]
    places, poses = [f"P{n}" for n in range(1, 17)], [f"L{n}" for n in range(1, 61)]
    board = {"board": {"rows": 8, "columns": 10, "pitch_mm": 30.0}, "placements": [{"id": p} for p in places]}
    board |= dict.fromkeys(("bars", "bar_poses", "scale", "target_set", "sphere"))
    session("board", "hall6", figure(grid, 0, places, 0.5), lambda d: d.update(board))
    lengths = [{"from": "M0", "to": "M3", "length_mm": 500.0, "expanded_uncertainty_mm": 0.01}]
    bar = {"id": "L", "role": "scale", "lengths": lengths}
    bar["marks"] = {f"M{n}": {"target": 900 + n, "point": "centre"} for n in range(4)}
    laid = {"bar_poses": [{"id": p, "bar": "L", "temperature_c": 20.0} for p in poses], "bars": [bar], "placements": []}
    laid["scale"] = {"kind": "bar", "bar": "L"}
    ends = np.array([[-250.0, 0, 0], [-100, 0, 0], [100, 0, 0], [250, 0, 0]])
    session("bar", "hall6", figure(ends, 900, poses, 1.5), lambda d: d.update(laid))


def make(out: Path) -> None:
    data = Path(os.environ.get("SPHERECAL_DATA", Path(__file__).resolve().parents[2] / "shared/data")).resolve()
    schemas = Path(__file__).resolve().parents[1] / "docs/schemas"
    (out / "printed").mkdir(parents=True)
    for name in ("DRIVERS", "BARS", "BALLS", "LIMITS", "SETTINGS"):
        os.environ[f"SPHERECAL_{name}"] = str(out.resolve() / "user" / name.lower())
    os.environ |= {"XDG_CONFIG_HOME": str(out.resolve() / "user"), "COLUMNS": "120", "SOURCE_DATE_EPOCH": "1700000000"}
    os.chdir(out)
    (data / "dome15").is_dir() and Path("DATA").symlink_to(data)
    codes: dict[str, int] = {}
    made = [f"export hall6/rig.json --to {one} -o exports/{one} --max-loss 1 --json" for one in FORMATS]
    for result, language in (("hall6", "en"), ("moved", "de"), ("board", "zh_CN")):
        report = f"report {result} --session s/{result} --language {language} -o report-{language}"
        made += [f"{report}.{ending}" for ending in ("pdf", "html", "json")]
    for line in [*PREPARED.strip().replace("\n", ";").split(";"), "edit", *COMMANDS.strip().replace("\n", ";").split(";")]:
        if line.strip() == "edit":
            edit()
        elif "DATA" not in line or Path("DATA").exists():
            for one in [*made, line] if "frame hall6" in line else [line]:
                images = " ".join(map(str, sorted(Path("s/demo/placements/P1").glob("*.*"))))
                run(shlex.split(one.replace("IMAGES", images)), codes)
    Path("codes.json").write_text(json.dumps(codes, indent=1), encoding="utf-8")
    for number, check in enumerate(sorted(Path("profile/checks").glob("*.json"))):  # named after the time of day
        check.rename(check.with_name(f"{number}.json"))
    shutil.copytree(schemas, "schemas")
    Path("DATA").unlink(missing_ok=True)


def normalised(file: Path) -> bytes:
    return VERSION.sub(rb"\1VERSION", TIMES.sub(b"TIME", file.read_bytes()))


def figures(text: str) -> np.ndarray:
    return np.array([float(one) for one in NUMBER.findall(text)])


def compared(a: Path, b: Path) -> str:
    """How two files differ, in words."""
    if not (a.is_file() and b.is_file()):
        return "MISSING in " + ("A" if b.is_file() else "B")
    if a.suffix in DRAWN:
        pages = [len(re.findall(rb"/Type\s*/Page\b", file.read_bytes())) for file in (a, b)]
        return "drawn" if pages[0] == pages[1] else f"drawn, PAGES {pages[0]} -> {pages[1]}"
    if normalised(a) == normalised(b):
        return "equal"
    if a.suffix == ".npy":
        x, y = np.load(a), np.load(b)
    else:
        x, y = (figures(normalised(file).decode("utf-8", "replace")) for file in (a, b))
    if x.shape != y.shape:
        return f"OTHER SHAPE: {x.shape} -> {y.shape} numbers"
    size = np.maximum(np.abs(x), np.abs(y))
    largest = np.max(np.abs(x - y) / np.where(size > 0, size, 1), initial=0)
    return f"NUMBERS differ by up to {largest:.2g} of their size" if largest > 0 else "words"


def compare(a: Path, b: Path) -> int:
    names = sorted({str(p.relative_to(root)) for root in (a, b) for p in root.rglob("*") if p.is_file()})
    found = {name: compared(a / name, b / name) for name in names}
    for name, how in found.items():
        if how != "equal":
            print(f"{name}: {how}")
    print(f"{len(found)} files, {sum(how == 'equal' for how in found.values())} equal byte for byte")
    return int(any(not how.startswith(("equal", "drawn", "words")) or "PAGES" in how for how in found.values()))


if __name__ == "__main__":
    if sys.argv[1] == "--compare":
        sys.exit(compare(Path(sys.argv[2]), Path(sys.argv[3])))
    make(Path(sys.argv[1]))
