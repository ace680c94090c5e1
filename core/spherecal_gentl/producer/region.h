// The memory shared by the cameras (any process that has loaded the .cti) and whoever steers them (control.py).
// region.py reads this file; raise layout_version whenever the bytes change.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace region {

constexpr uint32_t magic = 0x54474353;  // "SCGT"
constexpr uint32_t layout_version = 1;
constexpr uint32_t most_devices = 16;
constexpr uint64_t page = 4096;

using I32 = std::atomic<int32_t>;
using U32 = std::atomic<uint32_t>;
using I64 = std::atomic<int64_t>;
using U64 = std::atomic<uint64_t>;
static_assert(sizeof(U32) == 4 && sizeof(U64) == 8 && U64::is_always_lock_free, "atomics must be plain memory");

// What a client reads and writes through the camera's port, at these addresses; device.xml names them.
struct Registers {
    uint32_t width, height, offset_x, offset_y;                                                    // 0x00
    uint32_t pixel_format, acquisition_mode, acquisition_frame_count, frame_rate_enable;           // 0x10
    double frame_rate_hz, exposure_us;                                                             // 0x20
    double gain_db, trigger_delay_us;                                                              // 0x30
    uint32_t trigger_selector, trigger_mode, trigger_source, trigger_activation;                   // 0x40
    uint32_t exposure_mode, exposure_auto, gain_auto, temperature_selector;                        // 0x50
    uint32_t packet_size, packet_delay_ns, user_set_selector, indicator;                           // 0x60
    int64_t timestamp_latch, spare_1;                                                              // 0x70
    char user_id[64];                                                                              // 0x80
    char spare_2[64];                                                                              // 0xC0
};
static_assert(sizeof(Registers) == 0x100, "device.xml holds these addresses");

// Fault counts: 0 never, n > 0 the next n times, -1 until taken back.
struct Device {
    // written by the controller
    char serial[32];
    char user_id[64];  // as it left the factory
    char model[32];
    uint32_t sensor_width, sensor_height, source_bits, padding_bytes;  // 128
    double temperature_c, exposure_reference_us, link_bytes_per_s;     // 144
    I64 clock_offset_ns;
    U64 image_begun, image_published;  // 176: the image numbered n lies in slot n & 1
    U64 unplugged_until_ns;            // 192: 0 is plugged in
    U32 plug_generation;               // a handle opened before the last unplugging is dead
    I32 open_error;
    I32 read_error, read_error_count;  // 208
    U32 read_error_address;            // most_addresses: any register
    I32 write_error, write_error_count;
    U32 write_error_address;
    U32 port_delay_us;  // 232
    I32 event_error, event_error_count;
    I32 incomplete_count, dropped_trigger_count, lost_frame_count, late_count;
    U32 late_ms;
    I32 crash_count;  // 264
    char spare[20];
    // written by the cameras
    U64 opened, closed, reads, writes;  // 288
    U64 triggers, triggers_dropped, triggers_missed, frames_exposed;
    U64 frames_delivered, frames_incomplete, frames_lost, frames_late;
    U64 frames_underrun, acquisition_starts, acquisition_stops, last_image;
    U32 acquiring, open_by_pid;  // 416
    // the camera's memory
    U32 powered;  // 0: registers take the start-up user set at the next access
    uint32_t user_set_default, user_set_saved;
    char spare_1[588];
    Registers registers;  // 1024
    Registers user_set_1;
    char spare_2[2560];
};
constexpr uint32_t any_address = 0xFFFFFFFF;
static_assert(offsetof(Device, sensor_width) == 128 && offsetof(Device, image_begun) == 176, "as released");
static_assert(offsetof(Device, unplugged_until_ns) == 192 && offsetof(Device, port_delay_us) == 232, "as released");
static_assert(offsetof(Device, opened) == 288 && offsetof(Device, acquiring) == 416, "as released");
static_assert(offsetof(Device, registers) == 1024 && sizeof(Device) == page, "as released");

struct Header {
    uint32_t magic, layout_version, device_count, owner_pid;
    uint64_t slot_bytes, total_bytes;
    U64 line_pulses, line_pulse_ns;  // the wire to every camera's Line1, and when the last pulse rose
    char spare[4048];
};
static_assert(sizeof(Header) == page, "as released");

constexpr uint64_t images_at = page * (1 + most_devices);

}  // namespace region
