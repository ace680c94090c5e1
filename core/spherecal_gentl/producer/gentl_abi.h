// The numbers and prototypes of the GenTL interface that these producers use: names are ours, values
// are the standard's (GenTL 1.5). The EMVA's own header carries a licence that forbids changed copies, so none is here.
#pragma once

#include <cstddef>
#include <cstdint>

#if defined(_WIN32)
#define GENTL_EXPORT extern "C" __declspec(dllexport)
#else
#define GENTL_EXPORT extern "C" __attribute__((visibility("default")))
#endif

namespace gentl {

using Error = int32_t;
using Handle = void*;

// Only these may leave a producer in earnest: genicam takes codes it does not know for success.
enum : Error {
    success = 0,
    failed = -1001,
    not_initialised = -1002,
    not_implemented = -1003,
    resource_in_use = -1004,
    access_denied = -1005,
    invalid_handle = -1006,
    invalid_id = -1007,
    no_data = -1008,
    invalid_parameter = -1009,
    io_error = -1010,
    timeout = -1011,
    aborted = -1012,
    invalid_buffer = -1013,
    not_available = -1014,
    invalid_address = -1015,
    buffer_too_small = -1016,
    invalid_index = -1017,
    invalid_value = -1019,
    out_of_memory = -1021,
    busy = -1022,
};

constexpr uint64_t infinite = 0xFFFFFFFFFFFFFFFFull;

namespace datatype {
enum : int32_t { text = 1, i32 = 5, u32 = 6, u64 = 8, pointer = 10, flag = 11, size = 12 };
}

namespace tl_info {
enum : int32_t {
    id, vendor, model, version, type, name, path, display_name, encoding, version_major, version_minor
};
}

namespace interface_info {
enum : int32_t { id, display_name, type };
}

namespace device_info {
enum : int32_t {
    id, vendor, model, type, display_name, access, user_name, serial, version, timestamp_frequency
};
}

namespace access {  // how a device is opened, and how it stands
enum : int32_t { none = 1, readonly = 2, control = 3, exclusive = 4 };
enum : int32_t { can_write = 1, no_access = 3, is_busy = 4, open_by_us = 5, open_readonly_by_us = 6 };
}  // namespace access

namespace stream_info {
enum : int32_t {
    id, delivered, underrun, announced, queued, awaiting_delivery, started, payload_size, grabbing,
    defines_payload_size, type, most_chunks, least_buffers, alignment
};
}

namespace buffer_info {
enum : int32_t {
    base, size, user_pointer, timestamp, new_data, is_queued, is_filling, is_incomplete, type, size_filled, width,
    height, x_offset, y_offset, x_padding, y_padding, frame_id, has_image, image_offset, payload_type, pixel_format,
    pixel_format_namespace, delivered_height, chunk_size, chunk_layout, file_name, endianness, data_size,
    timestamp_ns, larger_than_buffer, has_chunks, is_composite
};
}

namespace part_info {
enum : int32_t {
    base, data_size, data_type, format, format_namespace, width, height, x_offset, y_offset, x_padding, source,
    delivered_height, region, purpose
};
}

namespace port_info {
enum : int32_t {
    id, vendor, model, type, module, little_endian, big_endian, can_read, can_write, not_accessible,
    not_implemented, version, name
};
}

namespace url_info {
enum : int32_t {
    url, schema_major, schema_minor, file_major, file_minor, file_subminor, sha1, address, size, scheme, file_name
};
}

namespace event_info {
enum : int32_t { type, in_queue, fired, largest, largest_info };
}

namespace event_data {
enum : int32_t { id, value };
}

namespace flush {
enum : int32_t { input_to_output, discard_output, all_to_input, unqueued_to_input, discard_all };
}

constexpr int32_t event_error = 0, event_new_buffer = 1;
constexpr uint64_t namespace_pfnc32 = 4;
constexpr size_t payload_is_image = 1;
constexpr int32_t little_endian = 1, pixels_big_endian = 2;

#pragma pack(push, 1)
struct NewBuffer {
    Handle buffer;
    void* user;
};
struct ErrorData {
    int32_t code;
    char text[60];
};
struct BufferInfoEntry {
    int32_t what, type;
    void* out;
    size_t size;
    Error result;
};
struct PortEntry {
    uint64_t address;
    void* buffer;
    size_t size;
};
#pragma pack(pop)

}  // namespace gentl
