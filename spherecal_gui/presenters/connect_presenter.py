"""The cameras found, those that are missing, and the bench, in words."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherecal.data.session import Bar
from spherecal_cameras.protocol import CameraStatus
from spherecal_gui import languages
from spherecal_gui.coverage import Level
from spherecal_gui.languages import camera_details, camera_trouble, error_text, translate
from spherecal_gui.presenters.bars_presenter import reminder
from spherecal_gui.presenters.bench_presenter import targets_words
from spherecal_gui.project import Artefacts
from spherecal_gui.tasks.jobs import artefacts_of, as_people_count

if TYPE_CHECKING:  # imports scipy, OpenCV and the kernels
    from spherecal_cameras.camera_network import WireCamera
    from spherecal_cameras.protocol import CameraInfo
    from spherecal_gui.presenters.drivers_presenter import DriverNote
    from spherecal_gui.tasks.live_detection import Connection

# Lost or damaged images beyond this share say that the link is ill; a healthy one loses none (spherecal_cameras).
_ILL = 0.01
_MOST_NAMED = 6


# The focal lengths of lenses on sale for machine vision, mm.
LENSES_MM = (4.0, 6.0, 8.0, 12.0, 12.5, 16.0, 25.0, 35.0, 50.0)


@dataclass(frozen=True)
class CameraLine:
    """One camera: what it is, how it is."""

    name: str
    model: str
    serial: str
    word: str
    level: Level
    about: str = ""  # serial and size of its images
    in_rig: bool = True
    listed: bool = False  # by a driver: it can be in the rig or left out
    cured_at: "WireCamera | None" = None  # on the network, where it needs an address
    builtin: bool = False  # the built-in driver would reach it
    details: str = ""  # the engine's own words, in English


@dataclass(frozen=True)
class LensLine:
    """What is stated of all cameras' lenses; None where nobody knows it."""

    focal_mm: float | None = None
    differ: bool = False  # cameras have different ones
    pitch_um: float | None = None  # as it was stated
    found_um: tuple[float, ...] = ()  # as cameras or data sheets say


@dataclass(frozen=True)
class BenchRow:
    """One artefact: what it is for, what it is."""

    title: str
    value: str
    level: Level = "none"


@dataclass(frozen=True)
class DrawnBench:
    """The ball and the bars on the bench, to be drawn."""

    diameter_mm: float | None = None
    targets: int = 0
    bars: tuple[tuple[str, tuple[float, ...]], ...] = ()  # name; marks, mm from the first
    sticker: tuple[tuple[str, float, float], ...] = ()  # one target's dots: name, x, y in mm
    between: tuple[str, str] = ("", "")  # the dots whose distance gives the scale


def camera_lines(
    connection: "Connection | None",
    expected: tuple[str, ...],
    wire: "tuple[WireCamera, ...]" = (),
    builtin: bool = False,
) -> list[CameraLine]:
    """Every camera that was found, after those that are missing; `builtin`: that driver can be used, and is not."""
    from spherecal_cameras.builtin_driver import unlisted
    from spherecal_cameras.protocol import Discovery

    found = connection.discovery if connection is not None else Discovery(())
    missing = [
        CameraLine(serial, "", serial, translate("Connect", "missing: plug it in, then search again"), "bad")
        for serial in expected
        if connection is not None and found.camera(serial) is None
    ]
    lines = [_line(connection, info) for info in found.cameras] if connection is not None else []
    lines.sort(key=lambda line: as_people_count(line.name))
    return [*missing, *lines, *(_unlisted_line(camera, wire, builtin) for camera in unlisted(found, wire))]


def _line(connection: "Connection", info: "CameraInfo") -> CameraLine:
    from spherecal_cameras.builtin_driver import on_wire
    from spherecal_cameras.new_recording import camera_name

    serial, status = info.serial, connection.source.statuses().get(info.serial)
    name = connection.names.get(serial) or connection.rig.names.get(serial, serial)
    size = next((report.image_size for report in connection.reports if report.serial == serial), None)
    known = ("" if name == serial else serial, "" if size is None else f"{size[0]} x {size[1]}")
    about = " · ".join(filter(None, known))
    called = camera_name(connection.profile, info)
    count = [camera_name(connection.profile, one) for one in connection.discovery.cameras].count(called)
    if count > 1:
        alike = translate("Connect", "{count} called {name}").format(count=count, name=called)
        about = f"{alike} · {about}".strip(" ·")
    line = CameraLine(name, model_text(info.model), serial, "", "none", about, listed=True)
    if not connection.profile.entry(serial).in_rig:
        return replace(line, word=translate("Connect", "left out of the rig"), in_rig=False)
    seen = on_wire(info, connection.wire)
    problem = connection.rig.problems.get(serial)
    if problem is not None and seen is not None and not seen.subnet_ok:
        return replace(line, level="bad", **_elsewhere(seen, connection.wire))
    if problem is not None and status is not None and status.state.usable:  # it sends images of another size
        return replace(line, word=" ".join(error_text(problem)), level="bad")
    if problem is not None and seen is not None and seen.controlled_by_other:
        return replace(line, word=translate("Cameras", "Another program is using it. Close that program."), level="bad")
    word, level = _health(status)
    details = camera_details(status) if status is not None and status.cause else ""
    return replace(line, word=word, level=level, details=details)


def _unlisted_line(camera: "WireCamera", wire: "tuple[WireCamera, ...]", builtin: bool) -> CameraLine:
    """A camera that answers on the network and that no driver lists."""
    from spherecal_cameras.makers import maker_of

    name = camera.user_name or camera.serial or camera.mac
    about = f"{camera.serial} · {camera.ip_address}".strip(" ·")
    line = CameraLine(name, f"{camera.maker} {camera.model}".strip(), f"{camera.mac} {camera.serial}", "", "bad", about)
    if not camera.subnet_ok:
        return replace(line, **_elsewhere(camera, wire))
    maker = maker_of(camera.maker)
    text = translate("Connect", "It answers, but no driver reaches it.")
    if maker is not None:
        text = translate("Connect", "It answers, but no driver reaches it: install {package}.")
        text = text.format(package=maker.driver)
    return replace(line, word=text, builtin=builtin)


def _elsewhere(camera: "WireCamera", wire: "tuple[WireCamera, ...]") -> "dict[str, Any]":
    """What a row says of a camera in another subnet; an address is given to it alone, by its hardware address."""
    text = translate("Connect", "Its address {address} is in another subnet than this computer.")
    text = text.format(address=camera.ip_address)
    if sum(one.mac == camera.mac for one in wire) == 1:
        return {"word": text, "cured_at": camera}
    hint = translate("Connect", "Give the camera an address with its maker's program.")
    return {"word": f"{text} {hint}"}


def lens_line(connection: "Connection | None") -> LensLine | None:
    """What is stated of the lenses; None for recorded and simulated cameras, whose lenses are known."""
    if connection is None or connection.source.kind != "genicam":
        return None
    from spherecal_cameras.new_recording import pixel_pitch_um

    infos = [info for info in connection.discovery.cameras if connection.profile.entry(info.serial).in_rig]
    entries = [connection.profile.entry(info.serial) for info in infos]
    focal = {entry.focal_length_mm for entry in entries}
    stated = {entry.pixel_pitch_um for entry in entries}
    reports = {report.serial: report for report in connection.reports}
    pitches = {pixel_pitch_um(info, reports.get(info.serial)) for info in infos}
    found = tuple(sorted(one for one in pitches if one is not None))
    length, pitch = (next(iter(some)) if len(some) == 1 else None for some in (focal, stated))
    return LensLine(length, len(focal) > 1, pitch, found)


def model_text(model: str) -> str:
    """A camera's model as its maker calls it; of a simulated one its size, in the reader's language."""
    kind, _, size = model.partition(" ")
    return translate("Connect", "simulated {size}").format(size=size) if kind == "simulated" and size else model


def _health(status: CameraStatus | None) -> tuple[str, Level]:
    if status is None:
        return translate("Connect", "not opened"), "bad"
    if not status.state.usable:
        return camera_trouble(status), "bad"
    counted = status.counters
    lost = counted.incomplete + counted.underrun
    share = lost / max(counted.delivered + lost, 1)
    if share > _ILL:
        text = translate("Connect", "link: {share:.0f} % of the images damaged. Check cable, switch and packet size.")
        return text.format(share=100 * share), "caution" if counted.delivered else "bad"
    return translate("Connect", "ready"), "good"


def connect_summary(
    lines: Sequence[CameraLine], searching: bool, failure: str, drivers: "Sequence[DriverNote]" = ()
) -> tuple[str, Level]:
    """How many of how many, or what is in the way: what is wrong with a driver before the search that it made vain."""
    if searching:
        return translate("Connect", "Looking for cameras"), "none"
    answering = sum(bool(line.about) or line.listed for line in lines)
    if failure and answering and all(line.level == "bad" for line in lines):  # each row says what it lacks
        text = translate("Connect", "Cameras that answer, but cannot be used yet: {count}")
        return text.format(count=answering), "bad"
    if drivers and (failure or not lines):
        return f"{drivers[0].title} {drivers[0].steps[0]}".strip(), "bad"
    if failure:
        return failure, "bad"
    if not lines:
        return translate("Connect", "No cameras yet"), "bad"
    chosen = [line for line in lines if line.in_rig]
    # one that only answers on the network, as a code reader may, is not of this rig and hinders nobody
    rig = [line for line in chosen if line.listed or not line.about] or chosen
    good = sum(line.level == "good" for line in rig)
    text = translate("Connect", "{good} of {all} cameras ready").format(good=good, all=len(rig))
    without = [line.name for line in rig if line.level == "bad"]
    if without and good:
        named = languages.some(without, _MOST_NAMED)
        text = translate("Connect", "{good} of {all} cameras ready, without {cameras}")
        text = text.format(good=good, all=len(rig), cameras=named)
    bad = any(line.level == "bad" for line in rig)
    return text, "bad" if bad else "good" if good == len(rig) else "caution"


def lengths_texts(bar: Bar) -> list[str]:
    """A bar's lengths in mm: what each is called by, where the bench's description has it, and the certified one."""
    text = translate("Connect", "{nominal} nominal, {certified} certified")
    return [
        f"{one.length_mm:.3f}"
        if one.nominal_mm is None
        else text.format(nominal=f"{one.nominal_mm:g}", certified=f"{one.length_mm:.3f}")
        for one in bar.lengths
    ]


def bars_with_nominal(connection: "Connection | None", bars: Collection[str]) -> list[Bar]:
    """Those of these bars that have nominal lengths. `connection` None: there are no bars."""
    known = connection.plan.bars if connection is not None else ()
    return [bar for bar in known if bar.id in bars and any(one.nominal_mm is not None for one in bar.lengths)]


def _bars_words(connection: "Connection | None", bars: tuple[str, ...], kept: str) -> str:
    """The bars as the project keeps them, which is of no language; with nominal lengths, as people read them."""
    if connection is None or not bars_with_nominal(connection, bars):
        return kept.replace(" mm, ", ", ")  # the unit once, after the last
    own = [bar for bar in connection.plan.bars if bar.id in bars]
    return "\n".join("\n".join((f"{bar.id} (mm):", *lengths_texts(bar))) for bar in own)


def drawn_bench(connection: "Connection | None") -> DrawnBench:
    """The ball and the bars that lie on the bench, to be drawn."""
    targets = connection.plan.target_set if connection is not None else None
    if connection is None or targets is None:
        return DrawnBench()
    from spherecal_rigs.pose_plan import BarMarks  # imports scipy

    plan = connection.plan
    on_bars = {mark.target for bar in plan.bars for mark in bar.marks.values()}
    bars = tuple((bar.id, tuple(BarMarks.of(bar.id, bar.lengths).along_mm.tolist())) for bar in plan.bars)
    diameter = plan.fields.get("sphere", {}).get("nominal_diameter_mm")
    count, scale = len(set(targets.layouts) - on_bars), plan.fields.get("scale") or {}
    if scale.get("kind") != "target_spacing":
        return DrawnBench(diameter, count, bars)
    layout = next(iter(targets.layouts.values()))
    sticker = tuple((name, float(place[0]), float(place[1])) for name, place in layout.items())
    return DrawnBench(diameter, count, bars, sticker, (str(scale["from"]), str(scale["to"])))


def recording_text(source: str) -> str:
    """What is wrong with a recorded session that cannot be shown; empty for other sources."""
    kind, _, folder = source.partition(":")
    if kind != "replay":
        return ""
    if (Path(folder) / "session.json").is_file():
        return translate("Connect", "This recording is damaged.")
    return translate("Connect", "This folder contains no recording.")


def bench_rows(connection: "Connection | None", confirmed: Artefacts | None) -> list[BenchRow]:
    """What is on the bench: as somebody has confirmed it, else as the source or the chosen file says."""
    artefacts = confirmed
    if artefacts is None and connection is not None:
        artefacts = artefacts_of(connection.plan)
    if artefacts is None:
        unknown = translate("Connect", "not known: describe the bench")
        return [BenchRow(translate("Connect", "Targets"), unknown, "bad")]
    none = translate("Connect", "none: lengths will be arbitrary")
    no_check = translate("Connect", "none: the result cannot be verified")
    checks = _bars_words(connection, artefacts.check_bars, artefacts.check)
    scale = _bars_words(connection, (artefacts.scale_bar,) if artefacts.scale_bar else (), artefacts.scale)
    level: Level = "good" if confirmed is not None else "none"
    if artefacts.board:
        return [
            BenchRow(translate("Connect", "Board"), artefacts.target_set, level),
            BenchRow(translate("Connect", "Scale from the board's pitch"), artefacts.scale, level),
        ]
    text, worst = reminder(connection.plan.bars if connection is not None else (), date.today())
    targets = connection.plan.target_set if connection is not None else None
    about = artefacts.target_set if targets is None else targets_words(targets)  # as it is kept it is of no language
    certificates = [BenchRow(translate("Connect", "Certificates"), text, worst)] if text else []
    return [
        BenchRow(translate("Connect", "Targets on the ball"), about, level),
        BenchRow(translate("Connect", "Ball, about"), artefacts.ball or "-", level),
        BenchRow(translate("Connect", "Scale from"), scale or none, level if scale else "caution"),
        BenchRow(translate("Connect", "Verified by"), checks or no_check, level if checks else "caution"),
        *certificates,
    ]
