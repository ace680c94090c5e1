"""One opened GenICam camera in the camera process: set up, triggered, its images copied out, its loss noticed."""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from spherecal_cameras.genicam.features import FeatureError, NodeFeatures, plain
from spherecal_cameras.genicam.hub import Producer
from spherecal_cameras.genicam.messages import FrameMeta
from spherecal_cameras.genicam.pixels import first_grey, in_order, significant_bits
from spherecal_cameras.genicam.rings import Ring
from spherecal_cameras.genicam.setup import describe, exposure_us, gain_db, set_up
from spherecal_cameras.matching import CameraClock, RoundKeeper
from spherecal_cameras.protocol import CameraSettings, Counters, FeatureReport, SetupReport

# Buffers of the driver: 4 images of 5 MP for 12 cameras are 240 MB.
BUFFERS = 4
# Long enough for whatever waits to be handed over, short enough for the others.
_FETCH_S = 0.05
_LATCHED_S = 0.1  # the simulated GigE cameras take 1 ms, more on a busy machine; others answer at once
_RATE_WINDOW_S = 2.0
# A driver that does not count what waits may say that nothing does: looked for all the same, which costs 1 ms.
_POLL_S = 0.5
_HIDDEN = 3
_SYNCHRONISED = ("Master", "Slave")  # of the states of IEEE 1588
_MULTI_PART = 10  # PAYLOAD_TYPE_MULTI_PART
_BIG = 2  # PIXELENDIANNESS_BIG of GenTL
# The status light, by the standard's name: of ten cameras' descriptions at hand the four of 2019 and later have it.
_LIGHT = "DeviceIndicatorMode"
# As drivers name them in their stream's description: SphereCal's own, Basler's, Allied Vision's.
_PACKETS = {
    "packets missing": ("StreamMissingPacketCount", "Statistic_Failed_Packet_Count", "StatPacketMissed"),
    "packets resent": ("StreamResentPacketCount", "Statistic_Resend_Packet_Count", "StatPacketResent"),
}


class DeviceLost(Exception):
    """The camera does not answer any more; the text is the driver's."""


class Device:
    """An open camera; `close` never raises."""

    def __init__(self, producer: Producer, listed: Any, serial: str, settings: CameraSettings) -> None:
        from harvesters.core import Callback

        self.serial, self.settings = serial, settings
        self._ring: Ring | None = None
        self._acquiring = False
        self._acquirer: Any = producer.create(listed)
        try:
            self._prepare()
        except Exception:
            self.close()  # else this process itself holds the camera from now on
            raise
        self._rounds, self._clock = RoundKeeper(), CameraClock()
        self._can_ask = True
        self._last_poll_s, self._hidden = 0.0, 0
        self._largest = 0  # bytes of an image, where one was larger than the camera said
        self.common_clock = False
        self.unreadable = ""  # why the last image could not be used
        self._delivered = self._incomplete = 0
        self._arrivals: list[float] = []
        self.temperature_c: float | None = None
        self._exposure_us: float | None = None
        self._gain_db: float | None = None
        self._pixel_format = ""
        self._width: int | None = None
        self.last_image_s = self.acquiring_since_s = time.perf_counter()
        self.last_incomplete_s = float("-inf")
        self.unanswered = 0  # software triggers since the last image
        self._triggered = 0
        device = self

        class Incomplete(Callback):
            def emit(self, context: object | None = None) -> None:
                device._incomplete += 1
                device.last_incomplete_s = time.perf_counter()

        self._acquirer.add_callback(self._acquirer.Events.INCOMPLETE_BUFFER, Incomplete())

    def _prepare(self) -> None:
        """Set node maps, buffers, and how images are fetched from the driver."""
        self.features = NodeFeatures(self._acquirer.remote_device.node_map)
        stream = self._acquirer.data_streams[0]
        self._stream_features = NodeFeatures(stream.node_map)
        self._acquirer.num_buffers = max(BUFFERS, int(self._acquirer.min_num_buffers))
        # ms; genicam keeps Python's lock while it waits. With 0 drivers differ: 1 is what Harvesters has of itself
        self._acquirer.timeout_period_on_update_event_data_call = 1

    # --- setting up --------------------------------------------------------------------------------------------------

    def set_up(self, settings: CameraSettings) -> SetupReport:
        """Write all features and report each; images are stopped meanwhile."""
        was_acquiring = self._acquiring
        self.acquire(False)
        self.settings = settings
        report = set_up(self.serial, self.features, settings)
        self._exposure_us = exposure_us(self.features)
        self._gain_db = gain_db(self.features)
        self._pixel_format = str(self.features.read(self.features.name("pixel format")) or "")
        self._width = None if report.image_size is None else report.image_size[0]
        self.read_temperature()
        self.read_clock_state()
        self.latch_clock()
        self.acquire(was_acquiring)
        return report

    def image_bytes(self) -> int:
        """Bytes that an image needs in the ring: 2 a pixel where there are more than 8 bits."""
        width, height = self.features.number("width") or 0, self.features.number("height") or 0
        deep = significant_bits(self._pixel_format) > 8
        size = int(width * height) * (2 if deep else 1)
        return max(size or int(self.features.read("PayloadSize") or 0), self._largest)

    @property
    def outgrown(self) -> bool:
        """Whether an image was larger than what the camera had said: `image_bytes` has room for it now."""
        return self._ring is not None and self._largest > self._ring.slot_bytes

    def describe(self) -> tuple[FeatureReport, ...]:
        """All features with their present values."""
        found = []
        for label, names in _PACKETS.items():
            value = self._stream_features.first(names)
            if value is not None:
                found.append(FeatureReport(label, value, got=str(self._stream_features.read(value))))
        return (*describe(self.features), *found)

    def indicate(self, on: bool) -> tuple[FeatureReport, ...]:
        """Switch the camera's own light on or off; the report is empty where it has none that can be switched now."""
        try:
            got = self.features.write(_LIGHT, "Active" if on else "Inactive")
        except FeatureError:
            return ()
        return (FeatureReport("light", _LIGHT, got=str(got)),)

    def use_ring(self, ring: Ring) -> None:
        """Write images into this ring from now on; the one before is closed."""
        if self._ring is not None:
            self._ring.close()
        self._ring = ring

    # --- images ------------------------------------------------------------------------------------------------------

    @property
    def acquiring(self) -> bool:
        """Whether the camera sends images, or would if triggered."""
        return self._acquiring

    def acquire(self, on: bool) -> None:
        """Let the camera send images, or not."""
        if on == self._acquiring:
            return
        if on:
            self._rounds = RoundKeeper()
            self._guard(self._acquirer.start)
            self.acquiring_since_s = self.last_image_s = time.perf_counter()
            self.unanswered = 0
        else:
            self._guard(self._acquirer.stop)
        self._acquiring = on

    def trigger(self, round_number: int) -> None:
        """Take one image by software, for this trigger round."""
        name = self.features.name("software trigger")
        if name is None:
            raise FeatureError("the camera has no software trigger")
        self._rounds.triggered(round_number, time.perf_counter())
        self.unanswered += 1
        self._triggered += 1
        self.features.execute(name)

    def schedule(self, round_number: int, at_s: float) -> int:
        """Expect an image at a future moment; that moment by the camera's clock, in ns."""
        if not self.common_clock:
            raise FeatureError("its clock is not synchronised (IEEE 1588)")
        at_ns = self._clock.camera_ns(at_s)
        if at_ns is None:
            raise FeatureError("its clock cannot be read")
        self._rounds.triggered(round_number, at_s)
        self.unanswered += 1
        self._triggered += 1
        return at_ns

    def pump(self) -> FrameMeta | None:
        """Copy one waiting image into the ring and describe it; None if none waits or it is `unreadable`."""
        if not self._acquiring or self._ring is None:
            return None
        raw = self._fetch()
        if raw is None:
            return None
        try:
            return self._copy(raw, self._ring)
        finally:
            # False: not blanked first, which costs as much as the copy
            self._guard(lambda: raw.parent.queue_buffer(raw, False))

    def waits(self) -> bool:
        """Whether an image waits in the driver; True too where it cannot say."""
        if not self._can_ask:
            return True
        try:
            return self._acquirer.data_streams[0].num_awaiting_delivery > 0
        except Exception:
            self._can_ask = False
            return True

    def _fetch(self) -> Any | None:
        """A delivered buffer of GenTL, to be queued again; Harvesters' own would be lost where it cannot be read."""
        if self.waits():
            # asked or not: 1e-6 s polls once, 0 would wait for ever
            return self._try(_FETCH_S if self._can_ask else 1e-6)
        now = time.perf_counter()
        if now - max(self.last_image_s, self._last_poll_s) < _POLL_S:
            return None
        self._last_poll_s = now
        found = self._try(1e-6)
        self._hidden += found is not None
        if self._hidden >= _HIDDEN:  # once may be chance: it came between the two questions
            self._can_ask = False
        return found

    def _try(self, timeout: float) -> Any | None:
        return self._guard(lambda: self._acquirer.try_fetch(timeout=timeout, is_raw=True))

    def _copy(self, raw: Any, ring: Ring) -> FrameMeta | None:
        arrived = time.perf_counter()
        try:
            component, image = first_grey(self._components(raw))
            pixel_format = str(component.data_format)
            big = _optional(lambda: int(raw.pixel_endianness)) == _BIG
            image, bits = in_order(image, significant_bits(pixel_format), big)
        except (ValueError, KeyError, IndexError, AttributeError, TypeError, AssertionError) as error:
            self.unreadable = str(error) or type(error).__name__
            return None
        if image.nbytes > ring.slot_bytes:
            self.unreadable = f"an image of {image.shape[1]} x {image.shape[0]} px, larger than the camera says"
            self._largest = max(self._largest, image.nbytes)
            return None
        self.unreadable = ""
        slot, sequence = ring.write(image)
        frame_id = _optional(lambda: int(raw.frame_id))
        stamp = _optional(lambda: self._stamp_ns(raw)) or None  # 0: the producer has none
        taken = self._clock.host_time(stamp, arrived)
        stamp = stamp if self._clock.trusted else None
        uncertainty = self._clock.uncertainty_s
        self._delivered += 1
        self._arrivals.append(arrived)
        self.last_image_s, self.unanswered = arrived, 0
        return FrameMeta(
            self.serial,
            ring.name,
            slot,
            sequence,
            image.shape[0],
            image.shape[1],
            image.dtype.itemsize == 2,
            bits,
            pixel_format,
            taken,
            uncertainty,
            arrived,
            frame_id,
            stamp,
            self._rounds.assign(taken, uncertainty if stamp else 0.0, frame_id, stamp),
            self._exposure_us,
            self._gain_db,
            self.temperature_c,
            self.common_clock and stamp is not None,
        )

    def _components(self, raw: Any) -> list[Any]:
        from harvesters.core import Buffer, Payload

        nodes = self._acquirer.remote_device.node_map
        try:
            if int(raw.payload_type) == _MULTI_PART:  # one of an unknown format is no reason to lose the others
                parts = [_optional(lambda part=part: Payload._build_component(raw, part, nodes)) for part in raw.parts]
                return [part for part in parts if part is not None]
            payload = Buffer(module=raw, node_map=nodes, acquire=self._acquirer).payload
        except KeyError as error:
            raise ValueError(f"a pixel format that is not in the standard, number {error}") from None
        except Exception as error:  # the driver does not say what is in the buffer
            raise ValueError(plain(error)) from None
        return [] if payload is None else list(payload.components)

    def _stamp_ns(self, raw: Any) -> int | None:
        stamp = _optional(lambda: int(raw.timestamp_ns))
        if stamp is not None:
            return stamp
        ticks = int(raw.timestamp)
        rate = _optional(lambda: int(self._acquirer.device.timestamp_frequency)) or _optional(
            lambda: int(self.features.number("time stamp rate") or 0)
        )
        return ticks * 1_000_000_000 // rate if rate else ticks

    # --- health ------------------------------------------------------------------------------------------------------

    def check(self) -> None:
        """Read a register past all caches: access status shows losses with some producers only (harvesters 272)."""
        node = self.features.node(self.features.name("width") or "")
        if node is None or self._width is None:
            return
        width = self._guard(lambda: node.get_value(False, True))
        if width != self._width:
            raise DeviceLost(f"its width reads as {width} instead of {self._width}")

    def read_temperature(self) -> None:
        """Read the temperature (degrees Celsius) into `temperature_c`, if there is one to read."""
        name = self.features.name("temperature")
        if name is None:
            return
        value = self.features.read(name)
        # an error of the driver that genicam does not know comes back as a number near zero, like 4.7e-310
        if not isinstance(value, int | float) or not -60 < value < 150 or 0 < abs(value) < 1e-6:
            value = None
        self.temperature_c = value

    def read_clock_state(self) -> None:
        """Note whether the camera's clock is synchronised with others' (IEEE 1588)."""
        latch, state = self.features.name("clock latch"), self.features.name("clock state")
        if state is None:
            return
        if latch is not None:
            with suppress(FeatureError):
                self.features.execute(latch)
        self.common_clock = str(self.features.read(state)) in _SYNCHRONISED

    def latch_clock(self) -> None:
        """Compare the camera's clock with the computer's, where it can be read and the last comparison is old."""
        command, value = self.features.name("time stamp latch"), self.features.name("latched time")
        if command is None or value is None or not self._clock.latch_is_old(time.perf_counter()):
            return
        before = time.perf_counter()
        try:
            self.features.execute(command)
        except FeatureError:
            return
        after = time.perf_counter()
        if self.features.is_done_late(command, _LATCHED_S):  # before that the value is of the latch before
            after = time.perf_counter()
        ticks = self.features.read(value)
        if isinstance(ticks, int) and ticks > 0:
            rate = self.features.number("time stamp rate") if value == "GevTimestampValue" else None
            self._clock.latch(before, after, int(ticks * 1e9 / rate) if rate else ticks)

    def counters(self, wanted_hz: float | None) -> Counters:
        """What was counted since opening, with the rate of the last two seconds."""
        now = time.perf_counter()
        self._arrivals = [at for at in self._arrivals if now - at <= _RATE_WINDOW_S]
        span = min(_RATE_WINDOW_S, max(now - self.acquiring_since_s, 0.1))
        underrun = _optional(lambda: int(self._acquirer.data_streams[0].num_underrun)) or 0
        rate = len(self._arrivals) / span
        return Counters(
            self._delivered, self._incomplete, underrun, rate_hz=rate, wanted_hz=wanted_hz, triggered=self._triggered
        )

    def close(self) -> None:
        """Release the camera; the first attempt fails where it was lost, the second one works."""
        for _ in range(2):
            with suppress(Exception):
                self._acquirer.destroy()
                break
        self._acquiring = False
        if self._ring is not None:
            self._ring.close()
            self._ring = None

    def _guard(self, call: Callable[[], Any]) -> Any:
        try:
            return call()
        except Exception as error:
            raise DeviceLost(plain(error)) from error


def _optional(call: Callable[[], Any]) -> Any | None:
    try:
        return call()
    except Exception:
        return None
