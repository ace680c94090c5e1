"""Which file is of which camera and placement: by the one pattern, "{camera}/{placement}.png", that names allow."""

import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from spherecal.base.errors import InputError, Words
from spherecal.base.messages.values import Phrase
from spherecal_app.recordings.video_frames import grouped_by_time
from spherecal_files.filesystem import as_id
from spherecal_files.toml_text import toml_of

IMAGES = frozenset({".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".pnm"})
VIDEOS = frozenset({".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm"})
ONLY_PLACEMENT = "P1"  # of images whose names give only cameras
_DEEPEST = 6
_MOST_FILES = 200_000
_SHOWN = 4
_MOST_CONFIG_BYTES, _LONGEST_REGEX = 1 << 20, 200
_EXAMPLE = "{camera}/{placement}.png"
_KINDS = {"camera": Phrase("the-camera"), "placement": Phrase("the-placement")}
_MOST_WILD = 6  # fields and stars in a pattern: matching stays fast

_CAMERA_WORDS = (
    "cam", "camera", "kamera", "kam", "view", "port", "sensor", "dev", "device", "ch", "channel", "c", "left", "right",
    "centre", "center", "middle", "top", "bottom", "front", "back", "rear", "side",
)  # fmt: skip
_PLACE_WORDS = (
    "p", "pos", "pose", "place", "placement", "frame", "f", "img", "image", "im", "set", "shot", "t", "time", "snap",
    "capture", "board", "calib", "dsc", "pic",
)  # fmt: skip
_CAMERA = re.compile(rf"(?:{'|'.join(_CAMERA_WORDS)})(?:[ _-]?(?:\d+|[a-z]))?", re.IGNORECASE)
_NUMBER = r"\d[\d _.:T-]*"
_PLACE = re.compile(rf"(?:{'|'.join(_PLACE_WORDS)})[ _-]?{_NUMBER}", re.IGNORECASE)
_SERIAL = re.compile(r"(?!(?:19|20)\d{6}$)\d{7,12}")  # no date; a time comes once
_TOKEN = re.compile(r"\d+|[^\W\d_]+|[\W_]+")
_FIELD = re.compile(r"\{camera\}|\{placement\}|\*\*/|\*")


@dataclass(frozen=True)
class ImageLayout:
    """Files ("/" below the folder) by camera and placement id, in natural order, and what is no part of it."""

    words: str
    pattern: str
    files: Mapping[str, Mapping[str, str]]
    placements: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def videos(self) -> bool:
        """Whether it is made of videos, one for each camera."""
        return all(PurePosixPath(path).suffix.lower() in VIDEOS for own in self.files.values() for path in own.values())


def recognise(folder: Path, pattern: str | None = None) -> ImageLayout:
    """The layout of the images or videos in a folder, by its pattern where one is given."""
    found = _listed(folder)
    if not found:
        raise InputError(
            Phrase("error-no-images-or-videos", {"folder": folder, "images": sorted(IMAGES), "videos": sorted(VIDEOS)})
        )
    if pattern is not None:
        return _by_pattern(folder, found, pattern, "files named by the pattern")
    kinds = [[path for path in found if PurePosixPath(path).suffix.lower() in kind] for kind in (IMAGES, VIDEOS)]
    if all(kinds):
        values = {
            "folder": folder, "images": len(kinds[0]), "image": kinds[0][0], "videos": len(kinds[1]),
            "video": kinds[1][0], "pattern": "{camera}" + PurePosixPath(kinds[1][0]).suffix,
        }  # fmt: skip
        raise InputError(Phrase("error-images-and-videos", values))
    words, chosen, rest = _known_program(found)
    # files whose name is that of another one beside it and a word, such as 0001_annot.png beside 0001.png
    stems = {path.rpartition(".")[0] for path in chosen}
    made = {path: re.sub(r"[ _.-]+[^\W\d_]{2,}$", "", path.rpartition(".")[0]) for path in chosen}
    overlays = {path for path, stem in made.items() if stem != path.rpartition(".")[0] and stem in stems}
    chosen, rest = [path for path in chosen if path not in overlays], [*rest, *sorted(overlays, key=natural)]
    regex = _anipose_regex(folder)
    if regex is not None:
        layout = _sorted_out(folder, chosen, lambda path: _by_regex(regex, path), regex.pattern, "Anipose's cam_regex")
        return replace(layout, left_out=(*layout.left_out, *rest))
    proposed = _proposed(chosen, videos=not kinds[0])
    if len(proposed) != 1:
        said = {"folder": folder, "files": _shown(chosen), "example": _EXAMPLE}
        given = Phrase("error-give-pattern", {"patterns": [f'--pattern "{one}"' for one in proposed]})
        raise InputError(Phrase("error-camera-part", said), given if proposed else "")
    layout = _by_pattern(folder, chosen, proposed[0], words or _said(proposed[0]))
    return replace(layout, left_out=(*layout.left_out, *rest))


def natural(text: str) -> tuple[tuple[int, int | str], ...]:
    """A key that sorts names as people count: cam2 before cam10."""
    return tuple((0, int(t)) if t.isdecimal() else (1, t) for t in _TOKEN.findall(text))


def _listed(folder: Path) -> list[str]:
    """The images and videos in a folder and below, hidden ones left out; links to folders are not followed."""
    if not folder.is_dir():
        raise InputError(Phrase("error-no-image-folder", {"folder": folder}))
    found: list[str] = []
    for parent, folders, names in os.walk(folder):
        here = Path(parent).relative_to(folder)
        deeper = len(here.parts) < _DEEPEST
        folders[:] = [one for one in folders if not one.startswith(".")] if deeper else []
        found += [
            (here / name).as_posix()
            for name in names
            if not name.startswith(".") and PurePosixPath(name).suffix.lower() in IMAGES | VIDEOS
        ]
        if len(found) > _MOST_FILES:
            raise InputError(Phrase("error-many-images", {"folder": folder, "most": _MOST_FILES}))
    return sorted(found, key=natural)


# --- what other programs write ---------------------------------------------------------------------------------------


def _known_program(found: list[str]) -> tuple[str, list[str], list[str]]:
    """The words for a program's own folder, the files in it that show the calibration, and the others."""
    for words, inside in (
        ("caliscope's calibration/extrinsic", re.compile(r"calibration/extrinsic/(cam|port)_\d+\.mp4")),
        ("videos as caliscope names them", re.compile(r"(cam|port)_\d+\.mp4")),
        ("Anipose's calibration folder", re.compile(r"calibration/[^/]+\.\w+")),
    ):
        chosen = [path for path in found if inside.fullmatch(path)]
        others = [path for path in found if path not in set(chosen)]
        if words.startswith("Anipose") and not any(path.startswith("videos-raw/") for path in others):
            continue
        if len(chosen) > 1:
            return words, chosen, others
    chosen = [path for path in found if (parts := path.split("/"))[1:-1] == ["extrinsic"] and len(parts) == 3]
    if chosen and all(path.split("/")[1:-1] in (["extrinsic"], ["intrinsic"]) for path in found):
        return "multical's extrinsic folders", chosen, [path for path in found if path not in set(chosen)]
    if all(re.fullmatch(r"cam\d+/\d{16,19}\.\w+", path) for path in found):
        return "Kalibr's data set folder (time stamps in nanoseconds)", found, []
    return "", found, []


def _anipose_regex(folder: Path) -> re.Pattern[str] | None:
    """Anipose's `cam_regex` of config.toml in the folder or the two around it; InputError for one that is unsafe."""
    for one in (folder.resolve(), *folder.resolve().parents[:2]):
        file = one / "config.toml"
        try:
            if not file.is_file() or file.stat().st_size > _MOST_CONFIG_BYTES:
                continue
            text = toml_of(file.read_text(encoding="utf-8")).get("triangulation", {}).get("cam_regex")
        except (OSError, ValueError, AttributeError):
            continue
        if not isinstance(text, str):
            continue
        try:
            compiled = re.compile(text)
        except (re.error, OverflowError, RecursionError):
            compiled = None
        if compiled is None or compiled.groups < 1 or len(text) > _LONGEST_REGEX or re.search(r"\)[*+{?]", text):
            raise InputError(Phrase("error-cam-regex", {"file": file, "regex": text[:_LONGEST_REGEX]}))
        return compiled
    return None


def _by_regex(regex: re.Pattern[str], path: str) -> dict[str, str] | None:
    """The camera in a file's name, as Anipose takes it."""
    found = regex.search(PurePosixPath(path).stem)
    return {"camera": found[1].strip()} if found is not None and found[1] and found[1].strip() else None


# --- patterns --------------------------------------------------------------------------------------------------------


def _proposed(found: list[str], videos: bool) -> list[str]:
    """The patterns that can be meant; exactly one where the names say it."""
    parts = [path.split("/") for path in found]
    if len({len(one) for one in parts}) > 1:
        return []
    fixed = [names.pop() if len(names := {one[i] for one in parts}) == 1 else None for i in range(len(parts[0]) - 1)]
    suffixes = {PurePosixPath(path).suffix for path in found}
    suffix = suffixes.pop() if len(suffixes) == 1 else ".*"
    free = [i for i, name in enumerate(fixed) if name is None]
    if len(free) > 1:
        return []
    stems = [PurePosixPath(one[-1]).stem for one in parts]

    def whole(folder_field: str, name: str) -> str:
        return "/".join([*(folder_field if f is None else _escaped(f) for f in fixed), name + suffix])

    if not free:
        return [whole("", name) for name in _flat(stems, videos)]
    tops = [one[free[0]] for one in parts]
    return [whole(field, name) for field, name in _in_folders(tops, stems, videos)]


def _in_folders(tops: Sequence[str], stems: Sequence[str], videos: bool) -> list[tuple[str, str]]:
    """(field of the folder, pattern of the name) of files in one folder each, of which one may be meant."""
    by_camera, by_place = (
        ("{camera}", _with_own(tops, stems, "placement")),
        ("{placement}", _with_own(tops, stems, "camera")),
    )
    if videos:
        return [("{camera}", "*")] if len(set(tops)) == len(tops) else []
    bare = [_without(stem, top) for top, stem in zip(tops, stems, strict=True)]
    folders_are = _kind(set(tops))
    names_are = _kind(set(bare))
    ranked = ("camera", None, "number", "place")  # from what is a camera's name to what is a placement's
    first, second = ranked.index(folders_are), ranked.index(names_are)
    if first < second:
        return [by_camera]
    return [by_place] if second < first else [by_camera, by_place]


def _kind(names: Collection[str]) -> str | None:
    """Whether all of these names say "camera", "place" (pose1) or only a "number" (0001, 50-0503343); None: neither."""
    if all(_CAMERA.fullmatch(name) for name in names):
        return "camera"
    if all(_PLACE.fullmatch(name) for name in names):
        return "place"
    return "number" if all(re.fullmatch(_NUMBER, name) for name in names) else None


def _without(stem: str, top: str) -> str:
    """A file's name without that of its folder, where it repeats it."""
    ends = r"(?!\d)" if top[-1].isdigit() else r"(?![^\W\d_])"  # not "a" of "image"
    return re.sub(rf"[ _-]?(?<![^\W_]){re.escape(top)}{ends}[ _-]?", "", stem, count=1) or stem


def _with_own(tops: Sequence[str], stems: Sequence[str], field: str) -> str:
    """The pattern of the names in folders, where every name may repeat its folder's: "{camera}_{placement}"."""
    other = "{camera}" if field == "placement" else "{placement}"
    for own in (
        f"{other}_{{{field}}}",
        f"{other}-{{{field}}}",
        f"{other}{{{field}}}",
        f"{{{field}}}_{other}",
        f"{{{field}}}-{other}",
    ):
        expected = [own.replace(other, re.escape(top)) for top in tops]
        if all(
            re.fullmatch(one.replace(f"{{{field}}}", ".+"), stem) for one, stem in zip(expected, stems, strict=True)
        ):
            return own
    return f"{{{field}}}"


def _flat(stems: Sequence[str], videos: bool) -> list[str]:
    """Patterns of names in one folder: of the parts that differ from name to name one is the camera's."""
    tokens = [_TOKEN.findall(stem) for stem in stems]
    if len({len(one) for one in tokens}) > 1:
        return []
    values = [[one[i] for one in tokens] for i in range(len(tokens[0]))]
    free = [i for i, own in enumerate(values) if len(set(own)) > 1]
    if not free:
        return []
    cameras = [i for i in free if _is_camera_token(values, i)]
    fewest = min((len(set(values[i])) for i in cameras), default=0)
    cameras = [i for i in cameras if len(set(values[i])) == fewest]
    if len(free) == 1:
        return [_joined(values, free[0], [])] if videos or cameras else []
    chosen = cameras if len(cameras) == 1 else [free[0], free[-1]]
    if videos:
        return []  # several videos of one camera
    return list(dict.fromkeys(p for i in chosen if (p := _joined(values, i, _places_of(values, i, free)))))


def _places_of(values: Sequence[Sequence[str]], camera: int, free: Sequence[int]) -> list[int]:
    """The parts that name the placement: all that differ, or the last alone where only that is common to cameras."""
    places = [i for i in free if i != camera]
    for own in (places, places[-1:]):
        by_camera: dict[str, list[tuple[str, ...]]] = {}
        for row, name in enumerate(values[camera]):
            by_camera.setdefault(name, []).append(tuple(values[i][row] for i in own))
        sets = [set(one) for one in by_camera.values()]
        if all(len(one) == len(set(one)) for one in by_camera.values()) and set.intersection(*sets):
            return own
    return places


def _is_camera_token(values: Sequence[Sequence[str]], at: int) -> bool:
    """Whether a part of names is a camera's: a word for one, or what follows such a word."""
    if all(_CAMERA.fullmatch(value) and not value.isdecimal() and len(value) > 1 for value in values[at]):
        return True
    if {value.lower() for value in values[at]} == {"l", "r"}:
        return True  # of a stereo pair
    if all(_SERIAL.fullmatch(value) for value in values[at]) and 2 * len(set(values[at])) <= len(values[at]):
        return True  # of which every one comes again
    return _word_before(values, at) is not None


def _word_before(values: Sequence[Sequence[str]], at: int) -> int | None:
    """Where a constant word for a camera precedes the part: "cam" of "cam1" and "cam_1"."""
    for back in (at - 1, at - 2):
        if back < 0 or len(set(values[back])) > 1:
            return None
        word = values[back][0]
        if word[0].isalpha():
            return back if word.lower() in _CAMERA_WORDS else None
    return None


def _joined(values: Sequence[Sequence[str]], camera: int, places: Sequence[int]) -> str:
    """The pattern in which one part is the camera's and the span of some others the placement's; "" if they cross."""
    first = camera if (word := _word_before(values, camera)) is None else word
    spans = {first: (camera, "{camera}")}
    if places:
        if min(places) < camera < max(places):
            return ""
        begin, end = min(places), max(places)
        while (
            begin >= 2
            and values[begin - 1][0][0] in "-_:. "
            and values[begin - 2][0].isdecimal()
            and len(set(values[begin - 2])) == 1
            and begin > camera + 2
        ):
            begin -= 2  # the constant part of a date or number
        spans[begin] = (end, "{placement}")
    text, i = "", 0
    while i < len(values):
        if i in spans:
            last, field = spans[i]
            text, i = text + field, last + 1
        else:
            text, i = text + (_escaped(values[i][0]) if len(set(values[i])) == 1 else "*"), i + 1
    return text


def _escaped(text: str) -> str:
    """A fixed part of a pattern; what would be a field or a star there matches as any text."""
    return re.sub(r"[{}*]+", "*", text)


def _compiled(pattern: str) -> re.Pattern[str]:
    fields = _FIELD.findall(pattern)
    if "{camera}" not in fields:
        raise InputError(Phrase("error-pattern-camera", {"pattern": pattern, "field": "{camera}"}))
    if len(fields) > _MOST_WILD or "{" in _FIELD.sub("", pattern):
        raise InputError(
            Phrase("error-bad-pattern", {"pattern": pattern, "camera": "{camera}", "placement": "{placement}"})
        )
    text, seen, at = "", set[str](), 0
    for found in _FIELD.finditer(pattern):
        fixed = pattern[at : found.start()]
        if not fixed and at and pattern[at - 1] == "}":  # between letters and digits, as in left01
            text += r"(?:(?<=\d)(?=\D)|(?<=\D)(?=\d))"
        text += re.escape(fixed)
        field, at = found[0], found.end()
        name = field.strip("{}")
        if field == "**/":
            text += "(?:[^/]+/)*?"
        elif field == "*":
            text += "[^/]*?"
        elif name in seen:
            text += f"(?P={name})"
        else:
            text += f"(?P<{name}>[^/]+?)"
            seen.add(name)
    return re.compile(text + re.escape(pattern[at:]))


def _by_pattern(folder: Path, found: Iterable[str], pattern: str, words: str) -> ImageLayout:
    compiled = _compiled(pattern)

    def named(path: str) -> dict[str, str] | None:
        match = compiled.fullmatch(path)
        return match.groupdict() if match is not None else None

    return _sorted_out(folder, found, named, pattern, words)


def _sorted_out(
    folder: Path, found: Iterable[str], named: Callable[[str], dict[str, str] | None], pattern: str, words: str
) -> ImageLayout:
    """The layout of files by what they are `named`: camera and placement, or None for a file that is no part of it."""
    files: dict[str, dict[str, str]] = {}
    names: dict[str, dict[str, str]] = {"camera": {}, "placement": {}}
    left_out: list[str] = []
    paths = list(found)
    for path in paths:
        own = named(path)
        if own is None:
            left_out.append(path)
            continue
        given = {"placement": ONLY_PLACEMENT, **own}
        camera, place = (_id(folder, names[kind], kind, given[kind]) for kind in ("camera", "placement"))
        if (other := files.setdefault(camera, {}).setdefault(place, path)) != path:
            values = {"folder": folder, "first": other, "second": path, "camera": camera, "place": place}
            raise InputError(Phrase("error-two-files", values))
    if not files:
        values = {
            "folder": folder, "count": len(paths), "pattern": pattern, "files": _shown(paths), "example": _EXAMPLE,
        }  # fmt: skip
        raise InputError(Phrase("error-pattern-fits-none", values))
    cameras = sorted(files, key=natural)
    places = sorted({place for own in files.values() for place in own}, key=natural)
    apart = len(cameras) > 1 and len(places) > 1 and all(sum(p in files[c] for c in cameras) < 2 for p in places)
    if apart and (timed := _by_time(files, cameras)) is not None:
        files, places, said = timed
        taken = {path for own in files.values() for path in own.values()}
        left_out += [path for path in paths if path not in taken and path not in left_out]
        words, apart = f"{words}, {said}", False
    if apart:
        first, second = (next(iter(files[camera].values())) for camera in cameras[:2])
        values = {"folder": folder, "pattern": pattern, "first": first, "second": second}
        raise InputError(Phrase("error-no-common-placement", values))
    ordered = {camera: dict(sorted(files[camera].items(), key=lambda item: natural(item[0]))) for camera in cameras}
    return ImageLayout(words, pattern, ordered, tuple(places), tuple(left_out))


def _by_time(
    files: Mapping[str, Mapping[str, str]], cameras: Sequence[str]
) -> tuple[dict[str, dict[str, str]], list[str], str] | None:
    """Files of placements named by time, the placements in order, how they were put together; None where not so."""
    names = {camera: sorted(files[camera], key=natural) for camera in cameras}
    grouped = grouped_by_time(names)
    if grouped is None:
        return None
    moments, said = grouped
    places = [names[cameras[0]][row] for row in moments[:, 0]]
    made = {
        camera: {place: files[camera][names[camera][row]] for place, row in zip(places, moments[:, c], strict=True)}
        for c, camera in enumerate(cameras)
    }
    return made, places, said


def _id(folder: Path, known: dict[str, str], kind: str, name: str) -> str:
    """The id for a name of the files; InputError where another name has it."""
    made = as_id(name, "")
    if not made or known.setdefault(made, name) != name:
        values = {"folder": folder, "kind": _KINDS[kind], "name": name, "other": known.get(made)}
        raise InputError(Phrase("error-one-id" if made else "error-no-id", values))
    return made


def _said(pattern: str) -> str:
    parts = pattern.split("/")
    folders = [part for part in parts[:-1] if "{" in part]
    if not folders:
        return "all files in one folder, named by camera" + (" and placement" if "{placement}" in pattern else "")
    return "a folder for each camera" if "{camera}" in folders[0] else "a folder for each placement"


def _shown(paths: Sequence[str]) -> Words:
    names = ", ".join(paths[:_SHOWN])
    return Phrase("and-more", {"names": names, "more": len(paths) - _SHOWN}) if len(paths) > _SHOWN else names
