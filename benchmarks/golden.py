"""All outputs of the program, to be equal before and after a change that moves code: `golden.py OUT`, `--compare A B`.

Made by the commands in golden.txt, in one process (5 min). Times of day and versions do not count.
"""

import contextlib
import json
import os
import re
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

AGES = rb'|\d+\.\d+ (?:s\.|h ago)|"age_hours": [\d.]+|"seconds": \{[^}]*\}'
TIMES = re.compile(rb"20(?!23)\d\d-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?" + AGES)
VERSION = re.compile(rb'(?i)("version": ?"|spherecal )\d+\.\d+\.\d+[^"\s,<]*')
DRAWN = {".pdf", ".html", ".png", ".svg"}
NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.]*\w)")


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
    lines = printed.read_text(encoding="utf-8").splitlines(keepends=True)  # progress depends on time
    printed.write_text("".join(x for x in lines if not x.endswith("...\n")), encoding="utf-8")
    print(codes[name[:200]], name[:110], flush=True)


def table(path: str) -> list[list[str]]:
    return [line.split(",") for line in Path(path).read_text(encoding="utf-8").splitlines()[1:]]


def session(name: str, of: str, rows: list[list[str]], changed: dict[str, Any] | None = None) -> None:
    """The session `of` under another name, with these observations, and with other parts; None: without it."""
    shutil.copytree(f"s/{of}", f"s/{name}")
    lines = ["placement,camera,target,point,u,v", *(",".join(map(str, row)) for row in rows)]
    Path(f"s/{name}/observations.csv").write_bytes("".join(f"{line}\r\n" for line in lines).encode())
    file = Path(f"s/{name}/session.json")
    document = json.loads(file.read_text(encoding="utf-8")) | (changed or {})
    file.write_text(json.dumps({k: v for k, v in document.items() if v is not None}), encoding="utf-8")


def seen(camera: int, points: np.ndarray, turn: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Pixels (n, 2) of points (n, 3) mm in a camera of hall6's result, the camera turned by a rotation vector."""
    one = json.loads(Path("hall6/rig.json").read_text(encoding="utf-8"))["cameras"][camera]
    rotation, lens = cv2.Rodrigues(np.array(turn))[0] @ one["rotation"], np.array(one["distortion"]["coefficients"])
    return cv2.projectPoints(points, rotation, np.array(one["translation_mm"]), np.array(one["matrix"]), lens)[0][:, 0]


def figure(points: np.ndarray, first: int, poses: list[str], spread: float) -> list[list[str]]:
    """Observations of a rigid figure (n, 3) mm in poses before the cameras of hall6, with noise of 0.05 px."""
    rng, rows = np.random.default_rng(len(poses)), []
    ball = np.array([row[1:4] for row in table("hall6/spheres.csv")], dtype=float)
    for pose in poses:
        world = (
            points @ cv2.Rodrigues(rng.normal(size=3) * spread)[0].T
            + ball.mean(axis=0)
            + rng.uniform(-0.5, 0.5, 3) * np.ptp(ball, axis=0)
        )
        for camera in range(6):
            uv = seen(camera, world) + rng.normal(0, 0.05, (len(points), 2))
            for n in np.flatnonzero(((uv > 0) & (uv < [2063, 1543])).all(axis=1)):
                rows.append([pose, f"C{camera + 1:02d}", first + n, "centre", *(f"{x:.6f}" for x in uv[n])])
    return rows


def edit() -> None:
    """Sessions with groups that are not linked, exchanged images, a camera that turned, a soft ball, a board, a bar."""
    parted = [r for r in table("s/rigA/observations.csv") if r[0][0] == "P" and (r[1] <= "C05") == (r[0] <= "P2")]
    session("unlinked", "rigA", parted, {"bars": [], "bar_poses": []})
    rows, swap, turned, bent = table("s/hall6/observations.csv"), {"C02": "C03", "C03": "C02"}, [], []
    session("swapped", "hall6", [[r[0], swap.get(r[1], r[1]) if r[0] == "P4" else r[1], *r[2:]] for r in rows])
    space = {tuple(r[:3]): r[3:6] for r in table("hall6/points.csv")}
    centre = {r[0]: np.array(r[1:4], dtype=float) for r in table("hall6/spheres.csv")}
    for placement, camera, target, point, *place in rows:
        uv = np.array(place, dtype=float)
        xyz = np.array([space.get((placement, target, point), [0, 0, 0])], dtype=float)
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
    board |= dict.fromkeys(("bars", "bar_poses", "scale", "target_set", "sphere"))  # type: ignore[arg-type]
    session("board", "hall6", figure(grid, 0, places, 0.5), board)
    length = {"from": "M0", "to": "M3", "length_mm": 500.0, "expanded_uncertainty_mm": 0.01}
    marks = {f"M{n}": {"target": 900 + n, "point": "centre"} for n in range(4)}
    laid: dict[str, Any] = {"scale": {"kind": "bar", "bar": "L"}, "placements": []}
    laid["bars"] = [{"id": "L", "role": "scale", "lengths": [length], "marks": marks}]
    laid["bar_poses"] = [{"id": p, "bar": "L", "temperature_c": 20.0} for p in poses]
    session("bar", "hall6", figure(np.array([-250.0, -100, 100, 250])[:, None] * [1, 0, 0], 900, poses, 1.5), laid)


def make(out: Path) -> None:
    data = Path(os.environ.get("SPHERECAL_DATA", Path(__file__).resolve().parents[2] / "shared/data")).resolve()
    (out / "printed").mkdir(parents=True)
    files = {f"SPHERECAL_{n}": str(out.resolve() / n) for n in ("DRIVERS", "BARS", "BALLS", "LIMITS", "SETTINGS")}
    os.environ |= files | {"XDG_CONFIG_HOME": str(out.resolve() / "user"), "COLUMNS": "120"}
    os.chdir(out)
    Path("DATA").symlink_to(data)
    codes: dict[str, int] = {}
    for line in Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines():
        if line == "edit":
            edit()
        elif "DATA" not in line or Path("DATA/dome15").exists():
            images = " ".join(map(str, sorted(Path("s/demo/placements/P1").glob("*.*"))))
            run(line.replace("IMAGES", images).split(), codes)
    Path("codes.json").write_text(json.dumps(codes, indent=1), encoding="utf-8")
    for number, check in enumerate(sorted(Path("profile/checks").glob("*.json"))):  # named after the time of day
        check.rename(check.with_name(f"{number}.json"))
    shutil.copytree(Path(__file__).parents[1] / "docs/schemas", "schemas")
    Path("DATA").unlink(missing_ok=True)


def compared(a: Path, b: Path) -> str:
    """How two files differ, in words."""
    if not (a.is_file() and b.is_file()):
        return "MISSING in " + ("A" if b.is_file() else "B")
    if a.suffix in DRAWN:
        pages = [len(re.findall(rb"/Type\s*/Page\b", file.read_bytes())) for file in (a, b)]
        return "drawn" if pages[0] == pages[1] else f"drawn, PAGES {pages[0]} -> {pages[1]}"
    one, two = (VERSION.sub(rb"\1VERSION", TIMES.sub(b"TIME", file.read_bytes())) for file in (a, b))
    if one == two:
        return "equal"
    if a.suffix == ".npy":
        x, y = np.load(a), np.load(b)
    else:
        one, two = (text.replace(b"true", b"1").replace(b"false", b"0") for text in (one, two))
        x, y = (np.array(NUMBER.findall(text), dtype=float) for text in (one, two))
    if x.shape != y.shape:
        return f"OTHER SHAPE: {x.shape} -> {y.shape} numbers"
    largest = np.max(np.abs(x - y) / np.maximum(np.maximum(np.abs(x), np.abs(y)), 1e-300), initial=0)
    return f"NUMBERS differ by up to {largest:.2g} of their size" if largest > 0 else "words"


def compare(a: Path, b: Path) -> int:
    names = sorted({str(p.relative_to(root)) for root in (a, b) for p in root.rglob("*") if p.is_file()})
    found = {name: compared(a / name, b / name) for name in names}
    print("\n".join(f"{name}: {how}" for name, how in found.items() if how != "equal"))
    print(f"{len(found)} files, {sum(how == 'equal' for how in found.values())} equal byte for byte")
    return int(any(not how.startswith(("equal", "drawn", "words")) or "PAGES" in how for how in found.values()))


if __name__ == "__main__":
    sys.exit(compare(*map(Path, sys.argv[2:4])) if sys.argv[1] == "--compare" else make(Path(sys.argv[1])))
