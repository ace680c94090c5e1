"""Hostile inputs made on a file system with canaries."""

import io
import json
import os
import random
import re
import shutil
import warnings
import zipfile
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from spherecal_app.cli.main import main
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions


@dataclass(frozen=True)
class Ground:
    """The folders of the trial: what must never change, valid inputs, and where a try takes place."""

    root: Path

    @property
    def precious(self) -> Path:
        """What belongs to the user."""
        return self.root / "precious"

    @property
    def here(self) -> Path:
        """The folder that the commands run in, one of the user's."""
        return self.precious / "work"

    @property
    def valid(self) -> Path:
        """Valid inputs, copied for every try."""
        return self.root / "valid"

    @property
    def given(self) -> Path:
        """The hostile copy of this try."""
        return self.root / "in"

    @property
    def out(self) -> Path:
        """Where the try may write."""
        return self.root / "out"


def make_ground(root: Path) -> Ground:
    """Fill the folders; the valid inputs are written by the commands themselves."""
    ground = Ground(root)
    for name in (
        "thesis.tex",
        "secret.key",
        ".bashrc",
        ".git/config",
        ".ssh/authorized_keys",
        "rig.json",
        "work/rig.json",
        "work/notes.txt",
    ):
        path = ground.precious / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"the user's own {name}\n" * 3)
    valid = ground.valid
    # the smallest session that calibrates well as a rigid ball, in 0.7 s
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=40, placements=4, bar_poses=2))
    write_session(session, truth, valid / "session")
    _project(valid)
    _pictures(valid)
    for words in _BUILD:
        said = io.StringIO()
        with redirect_stdout(said), redirect_stderr(said):
            code = main([word.format(valid=valid) for word in words.split()])
        if code:
            raise RuntimeError(f"{words}: {code} {said.getvalue()[-500:]}")
    issuer = {"format": "spherecal/issuer", "version": 1, "name": "L", "certificate_number": "1"}
    (valid / "issuer.json").write_text(json.dumps(issuer))
    (valid / "limits.json").write_text(json.dumps({"format": "spherecal/limits", "version": 1, "limits": {}}))
    return ground


_BUILD = (
    "calibrate {valid}/session -o {valid}/result1 --method rigid",
    "verify {valid}/session --rig {valid}/result1/rig.json -o {valid}/result1",
    "calibrate {valid}/session -o {valid}/result2 --method free",
    "profile save {valid}/result1 --to {valid}/profile --apply",
    "profile save {valid}/result2 --to {valid}/profile",
    "profile apply {valid}/profile 0002 --note because",
    "support-bundle {valid}/session -o {valid}/b.zip --result {valid}/result1",
    "ball export {valid}/result1 -o {valid}/ball.json",
    "export {valid}/result1/rig.json --to opencv -o {valid}/priors.yml --max-loss 1000",
    "export {valid}/result1/rig.json --to colmap -o {valid}/colmap --max-loss 1000",
    "bars add B7 --from-session {valid}/session --bar A --registry {valid}/bars.json",
    "report {valid}/result1 -o {valid}/report.pdf",  # loads what draws
    "detect {valid}/pictures/placements/P1/C01.png --targets {valid}/session/targets.json --csv {valid}/dots.csv",
)


def _pictures(valid: Path) -> None:
    """A session of small images in which nothing is to be seen."""
    folder = valid / "pictures"
    noise = np.random.default_rng(1).integers(0, 255, (90, 100), dtype=np.uint8)
    document = json.loads((valid / "session" / "session.json").read_bytes())
    places = []
    for place in ("P1", "P2", "P3"):
        images = {}
        for camera in ("C01", "C02", "C03"):
            images[camera] = f"placements/{place}/{camera}.png"
            (folder / images[camera]).parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(noise).save(folder / images[camera])
        places.append({"id": place, "images": images})
    cameras = [
        {"id": f"C0{n}", "image_size": [100, 90], "pixel_pitch_um": 4.8, "focal_length_mm": 8.0} for n in (1, 2, 3)
    ]
    document = {"format": "spherecal/session", "version": 1, "cameras": cameras, "placements": places,
                "target_set": "targets.json"}  # fmt: skip
    (folder / "session.json").write_text(json.dumps(document))
    shutil.copy(valid / "session" / "targets.json", folder)


def _project(valid: Path) -> None:
    folder = valid / "project"
    write = {
        "wizard.json": {
            "format": "spherecal/wizard", "version": 1, "source": "replay:x", "step": "place", "cameras": ["S1"],
            "looked": ["S1"], "placements": ["P1", "P2"], "scale_poses": [], "check_poses": ["K1"], "bench": "b",
            "artefacts": {"target_set": "t", "ball": "b", "scale": "s", "scale_bar": "A", "check_bars": ["B"]},
            "calibrated": {"inputs": [["P1", "t"]], "verdict": "valid"}, "failures": {"S1": "no light"},
            "saved": {"inputs": [["P1", "t"]], "verdict": "valid"}, "repairs": [["split", "C01"]], "limit": "0.1",
            "masks": [{"camera": "C01", "rectangle": [0, 0, 4, 4]}], "pose_bars": [["K1", "B"]], "bar_celsius": 20.5,
        },
        "capture.json": {
            "format": "spherecal/capture", "version": 1, "cameras": [{"id": "C01", "serial": "S1"}],
            "sets": [{"id": "P1", "taken": "2026-01-01", "images": {"C01": "placements/P1/C01.png"}}],
        },
        "session.json": {"format": "spherecal/session", "version": 1, "cameras": [], "bar_poses": []},
        "removed/P2-1/set.json": {"id": "P2", "taken": "t", "images": {"C01": "placements/P2/C01.png"}},
        "verification/capture.json": {"sets": [{"id": "K1", "taken": "t", "images": {"C01": "x.png"}}]},
    }  # fmt: skip
    for name, document in write.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document))
    for name in ("placements/P1/C01.png", "removed/P2-1/images/C01.png", "removed/P2-1/retaking", "wizard/P1.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")


# --- making it hostile -----------------------------------------------------------------------------------------------


def _texts(ground: Ground) -> list[Any]:
    return [
        "../../precious/thesis.tex",
        str(ground.precious),
        str(ground.precious / "secret.key"),
        "..",
        ".",
        "",
        "/",
        "~",
        "a" * 300,
        "a/../../precious",
        "x\\..\\y",
        "C:\\Windows",
        "\x00",
        "a\nb",
        "=cmd|' /C calc'!A0",
        "-1+1|cmd",
        "<img src=/dev/zero>",
        "--><!--",
        "\ud800",
        "ü" * 64,
        "\U0001d4b3" * 64,
        ".hidden",
        "con",
        10**400,
        1e308,
        -1,
        None,
        [[]] * 50,
        {"a": {}},
        True,
        "9" * 5000,
    ]


def _places(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = (
        document.items() if isinstance(document, dict) else (enumerate(document) if isinstance(document, list) else ())
    )
    return [path, *(place for key, value in inner for place in _places(value, (*path, key)))]


def spoil_text(ground: Ground, path: Path, chance: random.Random) -> None:
    """Put a hostile value somewhere into a JSON file; cut any other one."""
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, OSError, RecursionError):
        path.write_bytes(path.read_bytes()[: chance.randrange(40)] + chance.randbytes(20))
        return
    place = chance.choice(_places(document))
    value = chance.choice(_texts(ground))
    if not place:
        document = value
    else:
        inner = document
        for key in place[:-1]:
            inner = inner[key]
        if isinstance(inner, dict) and isinstance(value, str) and chance.random() < 0.3:
            inner[value] = inner.pop(place[-1])
        else:
            inner[place[-1]] = value
    path.write_text(json.dumps(document), encoding="utf-8", errors="surrogatepass")


def spoil_bytes(path: Path, chance: random.Random) -> None:
    """Change the bytes of a file in a way that its kind of reader may stumble over."""
    data = path.read_bytes()
    match path.suffix:
        case ".json":
            data = _spoiled_json(data, chance)
        case ".csv":
            data = _spoiled_table(data, chance)
        case ".zip":
            data = _spoiled_zip(data, chance)
        case ".xml" | ".yml":
            data = _spoiled_markup(data, chance)
        case _:  # images, covariance.npy
            data = _cut(data, chance) if chance.random() < 0.5 else _flipped(data, chance)
    path.write_bytes(data)


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)] + chance.randbytes(chance.choice((0, 20)))


def _flipped(data: bytes, chance: random.Random) -> bytes:
    changed = bytearray(data or b"x")
    for _ in range(chance.choice((1, 3, 30))):
        near = min(len(changed), chance.choice((32, 200, len(changed))))  # headers more often
        changed[chance.randrange(near)] = chance.randrange(256)
    return bytes(changed)


def _number(data: bytes, chance: random.Random, new: bytes) -> bytes:
    """One number of a text exchanged."""
    numbers = list(re.finditer(rb"-?[0-9]+(\.[0-9]+)?(e-?[0-9]+)?", data))
    if not numbers:
        return new + data
    begin, end = chance.choice(numbers).span()
    return data[:begin] + new + data[end:]


def _spoiled_json(data: bytes, chance: random.Random) -> bytes:
    match chance.randrange(12):
        case 0:
            new = b"[" * chance.choice((90, 1000, 200_000))
        case 1:
            new = _number(data, chance, b"[" * 99_000 + b"]" * 99_000)
        case 2:
            new = _number(data, chance, b"1" + b"0" * chance.choice((400, 4200, 5000)))
        case 3 | 4:
            new = _number(
                data, chance, chance.choice((b"NaN", b"-Infinity", b"1e999", b"1e308", b"-0", b"true", b"[]"))
            )
        case 5:
            new = data.replace(b"{", b'{"format":1,"id":"x","id":"y",', chance.choice((1, 5)))
        case 6:
            new = data.replace(b"{", b"{" + b",".join(b'"k%d":%d' % (i, i) for i in range(100_000)) + b",", 1)
        case 7 if chance.random() < 0.1:
            new = data.replace(b'"', b'"' + b"x" * (100 << 20), 1)
        case 8:
            new = data.decode(errors="replace").encode(chance.choice(("utf-16", "utf-8-sig", "utf-32")))
        case 9:
            new = data.replace(b"[", b"[" + b"0," * 60_000, 1)
        case 10:
            new = _flipped(data, chance)
        case _:
            new = _cut(data, chance)
    return new


def _spoiled_table(data: bytes, chance: random.Random) -> bytes:
    values = (
        b"nan",
        b"1e999",
        b"9" * 5000,
        b"=cmd|' /C calc'!A0",
        b'"',
        b"\0",
        b"../../x",
        b"\xff\xfe",
        b"",
        b"\r",
        b"-1",
    )
    match chance.randrange(8):
        case 0:
            return data + b"x" * chance.choice((20_000, 5 << 20))
        case 1:
            return data + b"\n" * (2 << 20)
        case 2:
            return data * 2
        case 3:
            return data.replace(b"\n", b"," * 3000 + b"\n", 1)
        case 4:
            return _cut(data, chance)
        case _:
            fields = data.split(b",")
            fields[chance.randrange(len(fields))] = chance.choice(values)
            return b",".join(fields)


def _spoiled_markup(data: bytes, chance: random.Random) -> bytes:
    laughs = b'<!DOCTYPE x [<!ENTITY a0 "ha">' + b"".join(
        b'<!ENTITY a%d "%s">' % (n, b"&a%d;" % (n - 1) * 10) for n in range(1, 12)
    )
    match chance.randrange(7):
        case 0:
            new = laughs + b']><document version="2.0.0">&a11;</document>'
        case 1:
            new = b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///dev/zero">]><document>&a;</document>'
        case 2:
            new = b"<a>" * 100_000
        case 3:
            new = _number(data, chance, b"0" + b"7" * 60_000)
        case 4:
            new = b"%YAML:1.0\n" + b"a: &a [x]\n" + b"".join(b"b%d: &b%d [%s]\n" % (n, n, b"*a," * 9) for n in range(9))
        case 5:
            new = _cut(data, chance)
        case _:
            new = _flipped(data, chance)
    return new


def _spoiled_zip(data: bytes, chance: random.Random) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as old:
            members = [(name, old.read(name)) for name in old.namelist()]
    except Exception:  # was spoilt before
        members = []
    if not members or chance.random() < 0.3:
        return _cut(data, chance) if chance.random() < 0.5 else _flipped(data, chance)
    made = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),  # of names that are there twice
        zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name, own in members:
            new.writestr(name, _spoiled_json(own, chance) if chance.random() < 0.2 else own)
        names = (
            "../x", "/tmp/x", "session/../../x", "session/n" + "n" * 250, "session/" + "d/" * 40 + "x", "C:x", "",
            "session\\..\\x", "session/session.json", "session/session.json/x", "session/\ud800x", "session/.",
        )  # fmt: skip
        for name in chance.sample(names, chance.randint(1, 2)):
            info = zipfile.ZipInfo(name.encode(errors="replace").decode())
            link = chance.random() < 0.3
            info.external_attr = (0o120777 if link else 0o644) << 16
            new.writestr(info, "/etc/passwd" if link else b"\0" * chance.choice((3, 3, 30 << 20)))
    return made.getvalue()


def spoil_kind(ground: Ground, path: Path, chance: random.Random) -> None:
    """Put something else in a file's or folder's place: a link, a pipe, a device, a huge file, a folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    match chance.randrange(9):
        case 0:
            os.mkfifo(path)
        case 1:
            path.symlink_to("/dev/zero")
        case 2:
            path.symlink_to(path)  # a loop
        case 3:
            path.symlink_to(ground.root / "nowhere")
        case 4:
            with path.open("wb") as file:
                file.write(b"\x89PNG\r\n\x1a\n" if chance.random() < 0.5 else b"{")
                file.truncate(12 << 30)
        case 5:
            path.mkdir()
        case 6 | 7:
            path.symlink_to(chance.choice([p for p in ground.precious.rglob("*") if p.is_file()]))
        case _:
            path.symlink_to(ground.precious, target_is_directory=True)


def spoil(ground: Ground, folder: Path, chance: random.Random) -> None:
    """One to three hostile changes below a folder (or of a file)."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        if folder.is_symlink() or not folder.exists():
            return
        inside = [p for p in (folder, *folder.rglob("*")) if p != folder or folder.is_file()]
        if not inside:
            return
        path = chance.choice(sorted(inside))
        if not path.is_file() or path.is_symlink() or path.stat().st_size > 1 << 20 or chance.random() < 0.4:
            spoil_kind(ground, path, chance)
        elif chance.random() < 0.5:
            spoil_text(ground, path, chance)
        else:
            spoil_bytes(path, chance)
