"""Cameras unlike our own: other names, units, entries and habits, through the real GenTL, genicam and Harvesters."""

import io
import os
import random
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spherecal_cameras.genicam.device import Device, DeviceLost
from spherecal_cameras.genicam.discovery import together
from spherecal_cameras.genicam.features import FeatureError
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.genicam.hub import Producer, clean
from spherecal_cameras.genicam.pixels import grey_pixels, in_order
from spherecal_cameras.genicam.rings import SLOTS, Ring, shared_memory_name
from spherecal_cameras.genicam.slots import Slot, assess
from spherecal_cameras.matching import CameraClock, RoundKeeper
from spherecal_cameras.network_lines import load_of
from spherecal_cameras.protocol import (
    CameraError,
    CameraInfo,
    CameraSettings,
    CameraState,
    FeatureReport,
    ProducerVerdict,
    Region,
    SetupReport,
)
from spherecal_gentl.producer import build_producer as build
from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from tests.built_producer import built_producer

SIZE = (320, 240)
XML = Path(build.__file__).with_name("device.xml").read_text(encoding="utf-8")
Change = Callable[[str], str]


# ---- descriptions of other cameras ----


def without(*names: str) -> Change:
    def change(xml: str) -> str:
        for name in names:
            xml = re.sub(rf'<(\w+) Name="{name}"[\s\S]*?</\1>', "", xml)
            xml = re.sub(rf"<p\w+>{name}</p\w+>", "", xml)
        return xml

    return change


def renamed(old: str, new: str) -> Change:
    return lambda xml: xml.replace(f'Name="{old}"', f'Name="{new}"').replace(f">{old}<", f">{new}<")


def with_nodes(feature: str, nodes: str) -> Change:
    """Nodes put into the place of a feature, which goes."""
    return lambda xml: re.sub(rf'<(\w+) Name="{feature}"[\s\S]*?</\1>', nodes, xml)


def entries(feature: str, *kept: str) -> Change:
    """An enumeration with these entries only."""

    def change(xml: str) -> str:
        found = re.search(rf'<Enumeration Name="{feature}"[\s\S]*?</Enumeration>', xml)
        assert found
        node = found[0]
        for entry in re.findall(r'<EnumEntry Name="(\w+)"', node):
            if entry not in kept:
                node = re.sub(rf'\s*<EnumEntry Name="{entry}"[\s\S]*?</EnumEntry>', "", node)
        return xml.replace(found[0], node)

    return change


def unavailable(entry: str) -> Change:
    """An entry of an enumeration that is listed and cannot be had."""
    return lambda xml: re.sub(
        rf'(<EnumEntry Name="{entry}"[^>]*>)', r"\1<pIsAvailable>Never</pIsAvailable>", xml
    ).replace("<Port Name", '<Integer Name="Never"><Value>0</Value></Integer><Port Name', 1)


def all_of(*changes: Change) -> Change:
    def change(xml: str) -> str:
        for one in changes:
            xml = one(xml)
        return xml

    return change


class Opened:
    """A camera opened as the camera process does it, and its ring."""

    def __init__(self, device: Device, report: SetupReport, rig: ProducerControl) -> None:
        self.device, self.report, self.rig = device, report, rig
        self.slot: Slot = SimpleNamespace(settings=device.settings)  # type: ignore[assignment]

    def told(self, feature: str) -> FeatureReport:
        return next(one for one in self.report.features if one.feature == feature)

    def image(self, round_number: int = 0, seconds: float = 10.0) -> Any:
        """The next image's words; triggered for a round where one is given. None where it cannot be read."""
        self.device.unreadable = ""
        if round_number:
            self.device.trigger(round_number)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if (meta := self.device.pump()) is not None:
                return meta
            if self.device.unreadable:
                return None
            time.sleep(0.002)
        return None

    def pixels(self, meta: Any) -> np.ndarray:
        ring = self.device._ring
        assert ring is not None
        image = ring.read(meta.slot, meta.sequence, meta.height, meta.width, meta.deep)
        assert image is not None
        return image


@pytest.fixture(name="odd")
def odd_cameras(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    cti = built_producer()

    @contextmanager
    def opened(
        words: str = "", change: Change | None = None, settings: CameraSettings | None = None, acquire: bool = True
    ) -> Iterator[Opened]:
        if change is not None:
            (tmp_path / "odd.xml").write_text(change(XML), encoding="utf-8")
            words += f" description={tmp_path / 'odd.xml'}"
        with loaded(words) as (producer, rig):
            listed = producer.devices()[0]
            settings = settings or CameraSettings(exposure_us=3500.0)
            device = Device(producer, listed, "A1", settings)
            ring: Ring | None = None
            try:
                report = device.set_up(settings)
                ring = Ring(shared_memory_name(), SLOTS, max(device.image_bytes(), 1), create=True)
                device.use_ring(ring)
                if acquire:
                    device.acquire(True)
                yield Opened(device, report, rig)
            finally:
                device.close()
                if ring is not None:
                    ring.unlink()

    @contextmanager
    def loaded(words: str, count: int = 1) -> Iterator[tuple[Producer, ProducerControl]]:
        monkeypatch.setenv("SPHERECAL_GENTL_ODD", words)
        cameras = [SimulatedCamera(f"A{i + 1}", *SIZE, model=f"Model {i % 2}") for i in range(count)]
        with ProducerControl(cameras) as rig:
            monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
            producer = Producer(str(cti))
            try:
                yield producer, rig
            finally:
                producer.close()

    return SimpleNamespace(opened=opened, loaded=loaded)


# ---- triggers ----


@pytest.mark.parametrize(
    "change", [without("TriggerSoftware"), entries("TriggerSource", "Line1"), without("TriggerMode", "TriggerSelector")]
)
def test_a_camera_that_takes_no_software_trigger_runs_freely(odd: Any, change: Change) -> None:
    with odd.opened(change=change) as camera:
        assert {"trigger mode", "software trigger"} & set(camera.report.missing)
        assert any("runs freely" in one.problem for one in camera.report.problems)
        assert camera.image() is not None


def test_another_trigger_serves_where_there_is_none_of_a_frame(odd: Any) -> None:
    with odd.opened(change=renamed("FrameStart", "AcquisitionStart")) as camera:
        assert camera.told("TriggerSelector").got == "AcquisitionStart"
        assert camera.image(1).round == 1


def test_without_a_common_clock_nothing_can_be_scheduled_and_it_is_said(odd: Any) -> None:
    with odd.opened(settings=CameraSettings(trigger="scheduled"), acquire=False) as camera:
        problems = {one.feature: one.problem for one in camera.report.problems}
        assert "has no Action1" in problems["trigger source"]
        assert "no action commands" in problems["ActionDeviceKey"]
        with pytest.raises(FeatureError, match="IEEE 1588"):
            camera.device.schedule(1, time.perf_counter())


# ---- numbers in other units ----

RAW = """<IntConverter Name="ExposureTimeRaw"><FormulaTo>FROM * 35</FormulaTo><FormulaFrom>TO / 35</FormulaFrom>
<pValue>Hidden</pValue><Slope>Increasing</Slope></IntConverter>"""
BASE = '<Float Name="ExposureTimeBaseAbs"><Value>35</Value></Float>'
MILLI = """<Converter Name="ExposureTime"><FormulaTo>FROM * 1000</FormulaTo><FormulaFrom>TO / 1000</FormulaFrom>
<pValue>Hidden</pValue><Unit>ms</Unit><Slope>Increasing</Slope></Converter>"""


def hidden(feature: str, nodes: str) -> Change:
    """A feature under a name that is unknown, and nodes before it."""

    def change(xml: str) -> str:  # a converter has the unit of what it converts
        xml = re.sub(rf'(<Float Name="{feature}"[\s\S]*?)<Unit>\w+</Unit>', r"\1", xml)
        return renamed(feature, "Hidden")(xml).replace("<Port Name", f"{nodes}<Port Name", 1)

    return change


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (renamed("ExposureTime", "ExposureTimeAbs"), "ExposureTimeAbs"),
        (hidden("ExposureTime", RAW + BASE), "ExposureTimeRaw"),
        (hidden("ExposureTime", MILLI), "ExposureTime"),
    ],
)
def test_the_exposure_is_set_in_the_cameras_own_unit(odd: Any, change: Change, name: str) -> None:
    with odd.opened(change=change, settings=CameraSettings(exposure_us=7000.0), acquire=False) as camera:
        told = camera.told("exposure")
        assert (told.node, told.problem) == (name, "")
        assert camera.device._exposure_us == pytest.approx(7000.0)
        assert camera.rig._region.devices[0]["registers"]["exposure_us"] == pytest.approx(7000.0)


def test_an_exposure_in_unknown_steps_says_so(odd: Any) -> None:
    with odd.opened(change=hidden("ExposureTime", RAW), acquire=False) as camera:
        assert "own units" in camera.told("exposure").problem


FACTOR = """<Converter Name="Gain"><FormulaTo>20 * LG(FROM)</FormulaTo><FormulaFrom>EXP(TO * 0.1151292546)</FormulaFrom>
<pValue>Hidden</pValue><Slope>Increasing</Slope></Converter>"""
GAIN_RAW = """<IntConverter Name="GainRaw"><FormulaTo>FROM / 10</FormulaTo><FormulaFrom>TO * 10</FormulaFrom>
<pValue>Hidden</pValue><Slope>Increasing</Slope></IntConverter>"""


def test_a_gain_that_is_a_factor_is_set_in_decibels(odd: Any) -> None:
    settings = CameraSettings(gain_db=6.0)
    with odd.opened(change=hidden("Gain", FACTOR), settings=settings, acquire=False) as camera:
        assert camera.told("gain").problem == ""
        assert camera.rig._region.devices[0]["registers"]["gain_db"] == pytest.approx(6.0, abs=0.01)
        assert camera.device._gain_db == pytest.approx(6.0, abs=0.01)


def test_a_gain_in_device_units_is_left_at_its_lowest_and_claims_no_decibels(odd: Any) -> None:
    settings = CameraSettings(gain_db=6.0)
    with odd.opened(change=hidden("Gain", GAIN_RAW), settings=settings, acquire=False) as camera:
        assert "own units" in camera.told("gain").problem
        assert camera.device._gain_db is None


# ---- switches, steps, read-only features ----

SWITCH = """<Enumeration Name="{name}"><EnumEntry Name="{off}"><Value>0</Value></EnumEntry>
<EnumEntry Name="{on}"><Value>1</Value></EnumEntry><Value>1</Value></Enumeration>"""


@pytest.mark.parametrize(
    ("name", "off", "on"),
    [
        ("GammaEnable", "Off", "On"),
        ("ReverseX", "False", "True"),
        ("LUTEnable", "Disabled", "Enabled"),
        ("BinningHorizontal", "X1", "X2"),
        ("BinningVertical", "Binning1x1", "Binning2x2"),
        ("BlackLevelAuto", "Manual", "Continuous"),
        ("TestPattern", "None", "GreyRamp"),
    ],
)
def test_an_enumeration_serves_as_a_switch(odd: Any, name: str, off: str, on: str) -> None:
    nodes = SWITCH.format(name=name, off=off, on=on)
    with odd.opened(change=lambda xml: xml.replace("<Port Name", f"{nodes}<Port Name", 1), acquire=False) as camera:
        assert (camera.told(name).got, camera.told(name).problem) == (off, "")


LIMIT = """<Integer Name="{name}"><Value>400000000</Value><Min>1000000</Min><Max>500000000</Max><Inc>1000</Inc>
</Integer>
<Enumeration Name="{switch}">{entries}<Value>{value}</Value></Enumeration>"""
ENTRY = '<EnumEntry Name="{name}"><Value>{value}</Value></EnumEntry>'


@pytest.mark.parametrize(
    ("name", "switch", "modes", "on"),
    [
        ("DeviceLinkThroughputLimit", "DeviceLinkThroughputLimitMode", ("Off", "On"), "On"),
        ("StreamBytesPerSecond", "BandwidthControlMode", ("SCPD", "StreamBytesPerSecond"), "StreamBytesPerSecond"),
    ],
)
def test_the_throughput_is_limited_by_the_cameras_own_name(
    odd: Any, name: str, switch: str, modes: tuple[str, ...], on: str
) -> None:
    listed = "".join(ENTRY.format(name=mode, value=number) for number, mode in enumerate(modes))
    nodes = LIMIT.format(name=name, switch=switch, entries=listed, value=0)
    for wanted, got, problem in ((9_000_500, "9000000", ""), (1000, "1000000", "took 1000000")):
        settings = CameraSettings(throughput_bytes_s=wanted)
        with odd.opened(
            change=lambda xml: xml.replace("<Port Name", f"{nodes}<Port Name", 1), settings=settings, acquire=False
        ) as camera:
            limit = camera.told("throughput limit")
            assert (limit.node, limit.got, camera.told("throughput switch").got) == (name, got, on)
            assert problem in limit.problem if problem else not limit.problem
            load = load_of(camera.device.describe(), 5.0)
            assert load is not None and "throughput limit" in load.controls
    with odd.opened(settings=CameraSettings(throughput_bytes_s=9_000_000), acquire=False) as camera:
        assert "does not have it" in camera.told("throughput limit").problem


def test_a_region_takes_the_cameras_steps(odd: Any) -> None:
    steps = {"Width": (16, 64), "OffsetX": (16, 0)}

    def change(xml: str) -> str:
        for name, (step, _) in steps.items():
            xml = re.sub(rf'(<Integer Name="{name}"[\s\S]*?<Inc>)\d+', rf"\g<1>{step}", xml)
        return xml.replace("<Formula>ALL - OFF</Formula>", "<Formula>ALL - OFF - 3</Formula>")

    with odd.opened(change=change) as camera:  # the most, 317, is between the steps
        assert (camera.told("width").got, camera.told("width").problem) == ("304", "")
        assert camera.image(1).width == 304
    settings = CameraSettings(region=Region(21, 2, 100, 80))
    with odd.opened(change=change, settings=settings) as camera:
        assert (camera.told("width").got, camera.told("left").got) == ("96", "16")
        assert "took 96" in camera.told("width").problem


def test_a_read_only_feature_that_is_as_wanted_is_no_problem(odd: Any) -> None:
    def change(xml: str) -> str:
        for register in ("WidthRegister", "HeightRegister", "PixelFormatRegister"):
            xml = re.sub(rf'(<IntReg Name="{register}">[\s\S]*?<AccessMode>)RW', r"\1RO", xml)
        return xml

    with odd.opened(change=change) as camera:
        assert camera.report.problems == ()
        assert camera.image(1).width == SIZE[0]


# ---- pixel formats ----


@pytest.mark.parametrize(
    ("change", "chosen", "bits"),
    [
        (entries("PixelFormat", "BayerRG8"), "BayerRG8", 8),
        (entries("PixelFormat", "Mono12p"), "Mono12p", 12),
        (entries("PixelFormat", "Mono12Packed", "BayerRG8"), "Mono12Packed", 12),
        (unavailable("Mono8"), "Mono10", 10),
    ],
)
def test_the_nearest_pixel_format_that_can_be_had_is_taken(odd: Any, change: Change, chosen: str, bits: int) -> None:
    with odd.opened(change=change) as camera:
        assert camera.told("pixel format").got == chosen
        assert "no Mono8" in camera.told("pixel format").problem
        meta = camera.image(1)
        assert (meta.pixel_format, meta.bits) == (chosen, bits)


def test_images_of_an_unknown_format_are_named_and_the_camera_stays(odd: Any) -> None:
    with odd.opened("format=0x81080099") as camera:
        assert camera.image(1) is None
        state, cause, remedy = assess(camera.slot, camera.device, time.perf_counter())
        assert (state, "not in the standard" in cause) == (CameraState.ERROR, True)
        assert "Mono8" in remedy
        for number in range(8):  # buffers go back: more images than buffers
            assert camera.image(number + 2) is None
        os.environ["SPHERECAL_GENTL_ODD"] = ""
        assert camera.image(20) is not None
        assert assess(camera.slot, camera.device, time.perf_counter())[0] is CameraState.STREAMING


@pytest.mark.parametrize("first", ["0x81080099", "0x010800C6"])  # unknown; Confidence8, a mask
def test_of_several_parts_the_image_is_taken(odd: Any, first: str) -> None:
    picture = np.random.default_rng(5).integers(0, 256, (SIZE[1], SIZE[0]), dtype=np.uint8)
    with odd.opened(f"parts={first}") as camera:
        camera.rig.set_image("A1", picture)
        meta = camera.image(1)
        assert (meta.round, meta.pixel_format) == (1, "Mono8")
        assert np.array_equal(camera.pixels(meta), picture)


def test_an_image_larger_than_was_said_gets_room(odd: Any) -> None:
    with odd.opened() as camera:
        small = Ring(shared_memory_name(), SLOTS, 1000, create=True)
        camera.device.use_ring(small)
        assert camera.image(1) is None
        assert "larger than the camera says" in camera.device.unreadable
        assert camera.device.outgrown
        large = Ring(shared_memory_name(), SLOTS, camera.device.image_bytes(), create=True)
        camera.device.use_ring(large)
        small.unlink()
        assert camera.image(2) is not None
        assert not camera.device.outgrown
        large.unlink()


def test_pixels_with_the_high_byte_first_are_put_in_order(odd: Any) -> None:
    picture = np.random.default_rng(3).integers(0, 4096, (SIZE[1], SIZE[0]), dtype=np.uint16)
    shown: list[np.ndarray] = []
    for words in ("", "big=1"):
        with odd.opened(words, settings=CameraSettings(pixel_format="Mono12", exposure_us=3500.0)) as camera:
            camera.rig.set_image("A1", (picture >> 4).astype(np.uint8))
            shown.append(camera.pixels(camera.image(1)))
    assert np.array_equal(shown[0], shown[1])
    assert len(np.unique(shown[0])) > 200


def test_values_at_the_upper_end_of_16_bits_are_taken_as_16_bits() -> None:
    image = np.arange(0, 65536, 16, dtype=np.uint16).reshape(64, 64)
    assert in_order(image, 12, big=False)[1] == 16


def test_yuv_images_have_their_brightness() -> None:
    grey = np.random.default_rng(1).integers(0, 256, (6, 8), dtype=np.uint8)
    for name, first in (("YUV422_8", True), ("YUV422_8_UYVY", False)):
        data = np.full((6, 8, 2), 128, np.uint8)
        data[..., 0 if first else 1] = grey
        component = SimpleNamespace(
            data_format=name, data=data.ravel(), width=8, height=6, num_components_per_pixel=2.0
        )
        assert np.array_equal(grey_pixels(component), grey)


# ---- drivers with other habits ----


@pytest.mark.parametrize(
    "words", ["ids=0", "stamps=none", "stamps=second", "waiting=0", "buffers=9", "ids=0 stamps=none"]
)
def test_every_round_gets_its_image(odd: Any, words: str) -> None:
    with odd.opened(words) as camera:
        rounds = [camera.image(number).round for number in range(1, 6)]
        assert rounds == [1, 2, 3, 4, 5]


def test_a_camera_whose_set_up_fails_is_let_go_of(odd: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with odd.loaded("") as (producer, _):
        listed = producer.devices()[0]
        with monkeypatch.context() as broken:
            broken.setattr(Device, "_prepare", lambda self: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                Device(producer, listed, "A1", CameraSettings())
        again = Device(producer, listed, "A1", CameraSettings())
        again.close()


def test_a_clock_that_is_none_is_not_trusted_and_one_that_is_set_once_is() -> None:
    wrapping, steady, eighth = CameraClock(), CameraClock(), CameraClock()
    for i in range(30):
        at = 100.0 + 0.3 * i
        wrapping.host_time(int(at % 1 * 1e9) + 1, at)
        steady.host_time(int((at if i < 15 else at - 50) * 1e9), at)
        eighth.host_time(int(at * 1e9 / 8), at)
    assert not wrapping.trusted
    assert steady.trusted
    assert not eighth.trusted
    assert wrapping.host_time(5, 200.0) == 200.0


def test_a_repeated_delivery_is_one_by_number_and_time() -> None:
    keeper = RoundKeeper()
    for number in (1, 2, 3):
        keeper.triggered(number, float(number))
    assert keeper.assign(1.01, 0.0, 0, None) == 1
    assert keeper.assign(2.01, 0.0, 0, None) == 2
    assert keeper.assign(3.01, 0.0, 7, 5) == 3
    assert keeper.assign(3.02, 0.0, 7, 5) is None


# ---- descriptions as files ----


@pytest.mark.parametrize("kind", ["zip", "file"])
def test_a_description_in_an_archive_or_beside_the_driver_is_read(odd: Any, tmp_path: Path, kind: str) -> None:
    plain = tmp_path / "other.xml"
    plain.write_text(renamed("ExposureTime", "ExposureTimeAbs")(XML), encoding="utf-8")
    words = f"description=file://{plain}"
    if kind == "zip":
        with zipfile.ZipFile(tmp_path / "other.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(plain, "other.xml")
        words = f"description={tmp_path / 'other.zip'}"
    with odd.opened(words) as camera:
        assert camera.told("exposure").node == "ExposureTimeAbs"
        assert camera.image(1) is not None


def test_real_cameras_descriptions_can_be_opened_and_set_up(odd: Any, shared_data: Path, tmp_path: Path) -> None:
    files = sorted((shared_data / "genicam_xml").glob("*.xml"))
    assert len(files) >= 10
    for file in files:
        text = file.read_text(encoding="utf-8", errors="replace")  # some have a line of their finder's before it
        start = text.find("<?xml") if "<?xml" in text else text.index("<RegisterDescription")
        kept = tmp_path / file.name
        kept.write_text(text[start:], encoding="utf-8")
        with odd.opened(f"description={kept}", acquire=False) as camera:
            # their registers are plain memory here, so that what is implemented and in range differs from the real ones
            assert {one.feature for one in camera.device.describe()} > {"width", "exposure"}, file.stem
            assert len(camera.report.features) > 4, file.stem


def test_a_broken_description_is_named_and_no_other_program_is_blamed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cti = built_producer()
    (tmp_path / "odd.xml").write_text(XML.replace("</Category>", "", 1), encoding="utf-8")
    monkeypatch.setenv("SPHERECAL_GENTL_ODD", f"description={tmp_path / 'odd.xml'}")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(cti.parent))
    with ProducerControl([SimulatedCamera("A1", *SIZE)]) as rig, GenicamSource(log_file=tmp_path / "log") as source:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        assert source.discover().serials == ("A1",)
        source.open(["A1"], {})
        for number in range(2):
            status = source.statuses()["A1"]
            assert status.state is CameraState.ERROR, (number, status)
            assert "description of its features" in status.cause
            time.sleep(1.5)  # it is tried again after 0.3 s and 0.5 s


def zipped(data: bytes, name: str = "a.xml") -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
    return packed.getvalue()


# What a damaged or hostile camera may send: the file's ending and its contents.
HOSTILE: dict[str, tuple[str, Callable[[], bytes]]] = {
    "bomb": ("zip", lambda: zipped(XML.encode().replace(b"</Reg", b"<!--" + b" " * (200 << 20) + b"--></Reg"))),
    "cut archive": ("zip", lambda: zipped(XML.encode())[:300]),
    "archive that leads out": ("zip", lambda: zipped(XML.encode(), "../../../../tmp/spherecal-escaped.xml")),
    "noise": ("xml", lambda: random.Random(1).randbytes(20_000)),
    "noise as archive": ("zip", lambda: random.Random(2).randbytes(20_000)),
    "nested 100,000 deep": (
        "xml", XML.replace("</Reg", f"{'<Group>' * 100_000}{'</Group>' * 100_000}</Reg").encode,
    ),
    "entities": ("xml", lambda: _laughs(XML).encode()),
    "refers to itself": (
        "xml", lambda: XML.replace(
            "<Port Name",
            '<Float Name="E1"><pValue>E2</pValue></Float><Float Name="E2"><pValue>E1</pValue></Float><Port Name',
            1,
        ).encode().replace(b"<pFeature>ExposureTime<", b"<pFeature>E1<"),
    ),
    "formula of 1 MB": (
        "xml", lambda: XML.replace(
            "<Port Name",
            f'<SwissKnife Name="S"><Formula>{"(" * 500_000}1{")" * 500_000}</Formula></SwissKnife><Port Name',
            1,
        ).encode(),
    ),
    "flipped bytes": ("xml", lambda: _flipped(XML.encode(), 40)),
}  # fmt: skip


def _laughs(xml: str) -> str:
    entities = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
    body = xml[xml.index("<RegisterDescription") :].replace("</Reg", "<Group Comment='&a9;'/></Reg")
    return f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a0 "lol">{entities}]>{body}'


def _flipped(data: bytes, times: int) -> bytes:
    chance, changed = random.Random(3), bytearray(data)
    for _ in range(times):
        changed[chance.randrange(len(changed))] = chance.randrange(1, 256)
    return bytes(changed)


@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_description_ends_neither_the_program_nor_other_cameras(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    """Read by genicam in the camera process, which may die of it: that is said, and no camera is believed to work."""
    cti = built_producer()
    ending, contents = HOSTILE[name]
    (tmp_path / f"odd.{ending}").write_bytes(contents())
    monkeypatch.setenv("SPHERECAL_GENTL_ODD", f"description={tmp_path / f'odd.{ending}'}")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(cti.parent))
    with ProducerControl([SimulatedCamera("A1", *SIZE)]) as rig, GenicamSource(log_file=tmp_path / "log") as source:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        assert source.discover().serials == ("A1",)
        with suppress(CameraError):  # the bomb, on a slow machine: the camera process does not answer in time
            source.open(["A1"], {})
            status = source.statuses()["A1"]
            assert status.state is not CameraState.ERROR or status.cause
    assert not Path("/tmp/spherecal-escaped.xml").exists()


# ---- texts that are not UTF-8 ----

# "you" in GBK, "ue" in Latin-1, half a character of UTF-8, and whatever else a driver's memory holds
TEXTS = ["c4e3bad3", "fc", "e4bd", *(np.random.default_rng(i).bytes(24).replace(b"\0", b"x").hex() for i in range(3))]


@pytest.mark.parametrize("texts", TEXTS)
def test_a_driver_whose_texts_are_not_utf8_opens_takes_images_and_errors_keep_their_meaning(
    odd: Any, texts: str
) -> None:
    from genicam import gentl

    with odd.opened(f"texts={texts}") as camera:
        assert not camera.report.problems
        assert all(camera.image(number) is not None for number in range(1, 4))
        with pytest.raises(gentl.TimeoutException):
            camera.device._acquirer.fetch(timeout=0.2)
        camera.rig.unplug("A1")
        with pytest.raises(DeviceLost) as lost:
            camera.device.check()
        assert "does not answer" in str(lost.value)
        str(lost.value).encode("utf-8")


def test_every_camera_of_such_a_driver_is_served_and_a_held_one_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SPHERECAL_GENTL_ODD", "texts=c4e3bad3")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(built_producer().parent))
    cameras = [SimulatedCamera(f"A{i}", *SIZE) for i in range(1, 4)]
    with ProducerControl(cameras) as rig, GenicamSource(log_file=tmp_path / "log") as source:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        serials = source.discover().serials
        rig.set("A2", open_error=-1005)
        source.open(serials, {})
        states = {serial: status.state for serial, status in source.statuses().items()}
        assert states == {"A1": CameraState.CONNECTED, "A2": CameraState.BUSY, "A3": CameraState.CONNECTED}
        rig.clear_faults("A2")
        until = time.monotonic() + 20.0
        while not source.capture_set().complete:
            assert time.monotonic() < until, source.statuses()


def test_the_first_set_is_complete_in_the_first_try_though_its_images_take_seconds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As four cameras of 16 MP do on a busy machine."""
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(built_producer().parent))
    cameras = [SimulatedCamera(f"A{i}", *SIZE) for i in range(1, 4)]
    with ProducerControl(cameras) as rig, GenicamSource(log_file=tmp_path / "log") as source:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        source.open(source.discover().serials, {})
        rig.set("A2", late_ms=2500, late_count=1)
        taken = source.capture_set()
        assert taken.complete and taken.attempts == 1 and taken.seconds > 2.0


# ---- names ----


def test_texts_of_drivers_are_one_line_of_plain_text() -> None:
    latin = b"T\xfcr 7".decode("utf-8", "surrogateescape")
    assert clean(latin) == "T\N{LATIN SMALL LETTER U WITH DIAERESIS}r 7"
    assert clean(" a\nb\0 ") == "a b"
    assert clean(None) == ""


def test_cameras_without_or_with_the_same_serial_number_are_told_apart(odd: Any) -> None:
    with odd.loaded("serial=", 3) as (producer, _):
        assert [info.serial for info in producer.infos()] == ["SphereCal-A1", "SphereCal-A2", "SphereCal-A3"]
    with odd.loaded("serial=77 model=M", 2) as (producer, _):
        names = [info.serial for info in producer.infos()]
        assert names == ["77 (SphereCal-A1)", "77 (SphereCal-A2)"]
        assert [producer.find(name).property_dict["id_"] for name in names] == ["SphereCal-A1", "SphereCal-A2"]
    with odd.loaded("serial=77", 2) as (producer, _):
        assert [info.serial for info in producer.infos()] == ["77 (Model 0)", "77 (Model 1)"]
        assert producer.find("77 (Model 1)").property_dict["id_"] == "SphereCal-A2"


def test_two_makers_cameras_of_one_number_are_two_and_one_that_is_reached_is_preferred() -> None:
    def verdict(file: str, vendor: str, model: str, access: Any) -> ProducerVerdict:
        return ProducerVerdict(file, True, "", "", (CameraInfo("7", model, vendor, file, access=access),))

    two = together([verdict("a", "Basler", "acA640", "free"), verdict("b", "Hikrobot", "MV-CA050", "free")])
    assert two.serials == ("7", "7 (MV-CA050)")
    one = together([verdict("a", "Basler", "acA640", "free"), verdict("b", "Basler AG", "acA640-90gm", "free")])
    assert (one.serials, len(one.doubles)) == (("7",), 1)
    reached = together([verdict("a", "Basler", "acA640", "unreachable"), verdict("b", "Basler", "acA640", "free")])
    assert [camera.producer for camera in reached.cameras] == ["b"]


def test_a_camera_on_two_interfaces_is_one_and_reached_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    def listed(interface: object, status: int) -> Any:
        known = {"serial_number": "7", "id_": "x", "vendor": "v", "model": "m"}
        return SimpleNamespace(property_dict=known, parent=interface, module=SimpleNamespace(access_status=status))

    producer = Producer.__new__(Producer)
    producer.file = "a.cti"
    both = [listed(object(), 3), listed(object(), 1)]
    monkeypatch.setattr(producer, "devices", lambda: both)
    (info,) = producer.infos()
    assert (info.serial, info.access) == ("7", "free")
    assert producer.find("7") is both[1]
