"""The bytes of the shared memory region between the simulated cameras and their controller; region.h is its twin."""

from collections import namedtuple
from typing import Any

import numpy as np

MAGIC = 0x54474353
LAYOUT_VERSION = 1  # raise it here and in region.h whenever one of them changes
MOST_DEVICES = 16
PAGE = 4096
IMAGES_AT = PAGE * (1 + MOST_DEVICES)
ANY_ADDRESS = 0xFFFFFFFF
FOR_EVER = 2**64 - 1


def _record(size: int, **fields: tuple[Any, int]) -> np.dtype[Any]:
    return np.dtype(
        {
            "names": list(fields),
            "formats": [form for form, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": size,
        }
    )


HEADER = _record(
    PAGE,
    magic=("u4", 0),
    layout_version=("u4", 4),
    device_count=("u4", 8),
    owner_pid=("u4", 12),
    slot_bytes=("u8", 16),
    total_bytes=("u8", 24),
    line_pulses=("u8", 32),
    line_pulse_ns=("u8", 40),
)

REGISTERS = _record(
    256,
    width=("u4", 0),
    height=("u4", 4),
    offset_x=("u4", 8),
    offset_y=("u4", 12),
    pixel_format=("u4", 16),
    acquisition_mode=("u4", 20),
    acquisition_frame_count=("u4", 24),
    frame_rate_enable=("u4", 28),
    frame_rate_hz=("f8", 32),
    exposure_us=("f8", 40),
    gain_db=("f8", 48),
    trigger_delay_us=("f8", 56),
    trigger_selector=("u4", 64),
    trigger_mode=("u4", 68),
    trigger_source=("u4", 72),
    packet_size=("u4", 96),
    packet_delay_ns=("u4", 100),
    indicator=("u4", 108),
    user_id=("S64", 128),
)

# What a camera counts since its region was made; `last_image` is the number of the picture last sent.
Counters = namedtuple(
    "Counters",
    "opened closed reads writes triggers triggers_dropped triggers_missed frames_exposed frames_delivered "
    "frames_incomplete frames_lost frames_late frames_underrun acquisition_starts acquisition_stops last_image",
)

DEVICE = _record(
    PAGE,
    serial=("S32", 0),
    user_id=("S64", 32),
    model=("S32", 96),
    sensor_width=("u4", 128),
    sensor_height=("u4", 132),
    source_bits=("u4", 136),
    padding_bytes=("u4", 140),
    temperature_c=("f8", 144),
    exposure_reference_us=("f8", 152),
    link_bytes_per_s=("f8", 160),
    clock_offset_ns=("i8", 168),
    image_begun=("u8", 176),
    image_published=("u8", 184),
    unplugged_until_ns=("u8", 192),
    plug_generation=("u4", 200),
    open_error=("i4", 204),
    read_error=("i4", 208),
    read_error_count=("i4", 212),
    read_error_address=("u4", 216),
    write_error=("i4", 220),
    write_error_count=("i4", 224),
    write_error_address=("u4", 228),
    port_delay_us=("u4", 232),
    event_error=("i4", 236),
    event_error_count=("i4", 240),
    incomplete_count=("i4", 244),
    dropped_trigger_count=("i4", 248),
    lost_frame_count=("i4", 252),
    late_count=("i4", 256),
    late_ms=("u4", 260),
    crash_count=("i4", 264),
    **{name: ("u8", 288 + 8 * i) for i, name in enumerate(Counters._fields)},
    acquiring=("u4", 416),
    open_by_pid=("u4", 420),
    powered=("u4", 424),
    user_set_default=("u4", 428),
    user_set_saved=("u4", 432),
    registers=(REGISTERS, 1024),
)
