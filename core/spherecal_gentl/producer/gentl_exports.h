// The exported functions of a GenTL producer, and what they say of its modules. Included once, by each transport.
#pragma once

#include "gentl_core.h"

#if defined(_WIN32)
#define NOMINMAX
#include <windows.h>
#else
#include <dlfcn.h>
#endif

namespace gentl {

template <class Body>
Error guarded(Body body) {
    try {
        Lock lock(state().mutex);
        if (!state().initialised) fail(not_initialised, "GCInitLib was not called");
        body(lock);
        return success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    } catch (const std::bad_alloc&) {
        return remember(out_of_memory, "out of memory");
    } catch (...) {
        return remember(failed, "unexpected error");
    }
}

inline Interface& find_interface(const char* id) {
    const std::string wanted = &required(id);
    for (const auto& link : producer().interfaces)
        if (link->name() == wanted) return *link;
    fail(invalid_id, "there is no interface " + wanted);
}

inline Camera& find_camera(Interface& link, const char* id) {
    const std::string wanted = &required(id);
    for (const auto& camera : link.cameras)
        if (camera->id() == wanted) return *camera;
    fail(invalid_id, "there is no camera " + wanted);
}

constexpr uint64_t search_ms = 500;

inline bool lists(const Interface& link, const char* id) {
    const std::string wanted = &required(id);
    return std::any_of(link.cameras.begin(), link.cameras.end(), [&](const auto& c) { return c->id() == wanted; });
}

inline Camera& listed_camera(Interface& link, uint32_t index) {
    for (const auto& camera : link.cameras)
        if (camera->listed && index-- == 0) return *camera;
    fail(invalid_index, "there are not that many cameras");
}

inline void about_device(Camera& camera, int32_t what, const Answer& answer) {
    namespace info = device_info;
    camera.before_asked();
    switch (what) {
        case info::id: return answer.text(camera.id());
        case info::vendor: return answer.text(camera.vendor());
        case info::model: return answer.text(camera.model());
        case info::type: return answer.text(camera.type());
        case info::display_name: return answer.text(camera.display_name());
        case info::access: return answer.i32(camera.access_status());
        case info::user_name: return answer.text(camera.user_name());
        case info::serial: return answer.text(camera.serial());
        case info::version: return answer.text(camera.version());
        case info::timestamp_frequency: return answer.u64(camera.timestamp_frequency());
        default: fail(not_implemented, "not known of a camera");
    }
}

inline void about_interface(const Interface& link, int32_t what, const Answer& answer) {
    namespace info = interface_info;
    switch (what) {
        case info::id: return answer.text(link.name());
        case info::display_name: return answer.text(link.display_name());
        case info::type: return answer.text(link.type());
        default: fail(not_implemented, "not known of an interface");
    }
}

inline std::string own_path() {
#if defined(_WIN32)
    HMODULE module = nullptr;
    char path[MAX_PATH] = "";
    GetModuleHandleExA(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
                       reinterpret_cast<LPCSTR>(&own_path), &module);
    GetModuleFileNameA(module, path, sizeof path);
    return path;
#else
    Dl_info about{};
    return dladdr(reinterpret_cast<void*>(&own_path), &about) && about.dli_fname ? about.dli_fname : "";
#endif
}

inline void about_producer(int32_t what, const Answer& answer) {
    namespace info = tl_info;
    const std::string path = own_path();
    switch (what) {
        case info::id: return answer.text(producer().id());
        case info::vendor: return answer.text(vendor);
        case info::model: return answer.text(producer().model());
        case info::version: return answer.text(version);
        case info::type: return answer.text(producer().type());
        case info::name: return answer.text(path.substr(path.find_last_of("/\\") + 1));
        case info::path: return answer.text(path);
        case info::display_name: return answer.text(producer().display_name());
        case info::encoding: return answer.i32(1);
        case info::version_major: return answer.u32(1);
        case info::version_minor: return answer.u32(5);
        default: fail(not_implemented, "not known of a producer");
    }
}

// Of a buffer, beyond the standard: how many packets of it never came.
constexpr int32_t missing_packets_info = 1000;


inline void about_image(const Buffer& buffer, int32_t what, const Answer& answer) {
    namespace info = buffer_info;
    if (!buffer.ever_filled) fail(no_data, "this buffer has never been filled");
    switch (what) {
        case info::width: return answer.count(buffer.width);
        case info::height: return answer.count(buffer.height);
        case info::x_offset: return answer.count(buffer.x);
        case info::y_offset: return answer.count(buffer.y);
        case info::x_padding: return answer.count(buffer.padding);
        case info::y_padding: return answer.count(0);
        case info::frame_id: return answer.u64(buffer.frame_id);
        case info::has_image: return answer.flag(buffer.payload == payload_is_image);
        case info::image_offset: return answer.count(0);
        case info::payload_type: return answer.count(buffer.payload);
        case info::pixel_format: return answer.u64(buffer.format);
        case info::pixel_format_namespace: return answer.u64(namespace_pfnc32);
        case info::delivered_height: return answer.count(buffer.delivered_height);
        case info::endianness: return answer.i32(buffer.big_endian ? pixels_big_endian : little_endian);
        case info::timestamp:
        case info::timestamp_ns: return answer.u64(buffer.timestamp_ns);
        default: fail(not_available, "not known of an image");
    }
}

inline void about_stream(Lock& lock, Stream& stream, int32_t what, const Answer& answer) {
    namespace info = stream_info;
    switch (what) {
        case info::id: return answer.text(stream.name());
        case info::delivered: return answer.u64(stream.delivered);
        case info::underrun: return answer.u64(stream.frames_lost());
        case info::announced: return answer.count(stream.buffers.size());
        case info::queued:
            return answer.count(size_t(std::count_if(stream.buffers.begin(), stream.buffers.end(), [](const auto& b) {
                return b->state == Buffer::queued || b->state == Buffer::filling;
            })));
        case info::awaiting_delivery: return answer.count(stream.waiting());
        case info::started: return answer.u64(stream.started);
        case info::payload_size: return answer.count(stream.payload_size(lock));
        case info::grabbing: return answer.flag(stream.running);
        case info::defines_payload_size: return answer.flag(true);
        case info::type: return answer.text(stream.owner.camera().type());
        case info::most_chunks: return answer.count(0);
        case info::least_buffers: return answer.count(stream.least_buffers());
        case info::alignment: return answer.count(1);
        default: fail(not_implemented, "not known of a stream");
    }
}

inline void about_buffer(const Stream& stream, Buffer& buffer, int32_t what, const Answer& answer) {
    namespace info = buffer_info;
    switch (what) {
        case info::base: return answer.pointer(buffer.memory);
        case info::size: return answer.count(buffer.size);
        case info::user_pointer: return answer.pointer(buffer.user);
        case info::new_data:
            answer.flag(buffer.fresh);
            if (answer.out) buffer.fresh = false;
            return;
        case info::is_queued: return answer.flag(buffer.state == Buffer::queued || buffer.state == Buffer::done);
        case info::is_filling: return answer.flag(buffer.state == Buffer::filling);
        case info::is_incomplete: return answer.flag(buffer.incomplete);
        case info::type: return answer.text(stream.owner.camera().type());
        case info::size_filled:
        case info::data_size: return answer.count(buffer.filled);
        case info::larger_than_buffer: return answer.flag(buffer.too_small);
        case info::has_chunks: return answer.flag(buffer.chunks);
        case missing_packets_info: return answer.count(buffer.missing_packets);
        case info::is_composite: return answer.flag(false);
        default: about_image(buffer, what, answer);
    }
}

inline void about_port(Module& module, int32_t what, const Answer& answer) {
    namespace info = port_info;
    const auto* remote = dynamic_cast<RemotePort*>(&module);
    switch (what) {
        case info::id: return answer.text(module.name());
        case info::vendor: return answer.text(vendor);
        case info::model: return answer.text(remote ? remote->device->camera().model() : module.kind());
        case info::type: return answer.text(remote ? remote->device->camera().type() : producer().type());
        case info::module: return answer.text(module.kind());
        case info::name: return answer.text(remote ? "Device" : module.kind());
        case info::can_read: return answer.flag(true);
        case info::little_endian: return answer.flag(!(remote && remote->device->big_endian()));
        case info::big_endian: return answer.flag(remote && remote->device->big_endian());
        case info::can_write: return answer.flag(!remote || !remote->device->readonly);
        case info::not_accessible:
        case info::not_implemented: return answer.flag(false);
        case info::version: return answer.text(version);
        default: fail(not_implemented, "not known of a port");
    }
}

inline void about_url(Module& module, int32_t what, const Answer& answer) {
    namespace info = url_info;
    switch (what) {
        case info::url: return answer.text(url_of(module));
        case info::schema_major:
        case info::schema_minor:
        case info::file_major: return answer.i32(1);
        case info::file_minor:
        case info::file_subminor: return answer.i32(0);
        case info::address: return answer.u64(xml_address);
        case info::size: return answer.u64(xml_of(module).size());
        case info::scheme: return answer.i32(url_of(module).compare(0, 5, "file:") == 0 ? 2 : 0);  // else in its registers
        default: fail(not_available, "not known of a description");
    }
}

// ---- the library ----------------------------------------------------------------------------------------------------

#define INFO_ARGUMENTS int32_t what, int32_t *type, void *out, size_t *size
#define ANSWER Answer{type, out, size}

GENTL_EXPORT Error GCInitLib() {
    try {
        Lock lock(state().mutex);
        if (state().initialised) fail(resource_in_use, "the producer is initialised already");
        state().initialised = true;
        return success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    }
}

GENTL_EXPORT Error GCCloseLib() {
    return guarded([&](Lock& lock) {
        close_all(lock);
        state().initialised = false;
    });
}

GENTL_EXPORT Error GCGetInfo(INFO_ARGUMENTS) {  // allowed before GCInitLib
    try {
        about_producer(what, ANSWER);
        return success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    }
}

GENTL_EXPORT Error GCGetLastError(Error* code, char* text, size_t* size) {
    const Failure last = last_failure();
    try {
        required(code) = last.code;
        answer_text(text, size, gentl::error_tail ? last.text + gentl::error_tail() : last.text);
        return success;
    } catch (const Failure& failure) {
        return failure.code;
    }
}

// ---- ports ----------------------------------------------------------------------------------------------------------

GENTL_EXPORT Error GCReadPort(Handle port, uint64_t at, void* out, size_t* size) {
    return guarded([&](Lock& lock) { read_port(lock, port, at, out, required(size)); });
}

GENTL_EXPORT Error GCWritePort(Handle port, uint64_t at, const void* data, size_t* size) {
    return guarded([&](Lock& lock) { write_port(lock, port, at, data, required(size)); });
}

GENTL_EXPORT Error GCReadPortStacked(Handle port, PortEntry* entries, size_t* count) {
    return guarded([&](Lock& lock) {
        const size_t wanted = required(count);
        for (*count = 0; *count < wanted; ++*count)
            read_port(lock, port, entries[*count].address, entries[*count].buffer, entries[*count].size);
    });
}

GENTL_EXPORT Error GCWritePortStacked(Handle port, PortEntry* entries, size_t* count) {
    return guarded([&](Lock& lock) {
        const size_t wanted = required(count);
        for (*count = 0; *count < wanted; ++*count)
            write_port(lock, port, entries[*count].address, entries[*count].buffer, entries[*count].size);
    });
}

GENTL_EXPORT Error GCGetPortURL(Handle port, char* url, size_t* size) {
    return guarded([&](Lock&) { answer_text(url, size, url_of(find_port(port))); });
}

GENTL_EXPORT Error GCGetNumPortURLs(Handle port, uint32_t* count) {
    return guarded([&](Lock&) { find_port(port), required(count) = 1; });
}

GENTL_EXPORT Error GCGetPortURLInfo(Handle port, uint32_t index, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        if (index != 0) fail(invalid_index, "a port has one description");
        about_url(find_port(port), what, ANSWER);
    });
}

GENTL_EXPORT Error GCGetPortInfo(Handle port, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_port(find_port(port), what, ANSWER); });
}

// ---- events ---------------------------------------------------------------------------------------------------------

inline std::unique_ptr<Event>* event_place(Module& source, int32_t kind) {
    auto* stream = dynamic_cast<Stream*>(&source);
    if (stream && kind == event_new_buffer) return &stream->event;
    auto* device = dynamic_cast<Device*>(&source);
    return device && kind == event_error ? &device->errors : nullptr;
}

GENTL_EXPORT Error GCRegisterEvent(Handle source, int32_t kind, Handle* out) {
    return guarded([&](Lock&) {
        required(out);
        std::unique_ptr<Event>* place = event_place(find<Module>(source, "module"), kind);
        if (!place) fail(not_implemented, "this event does not happen here");
        if (*place) fail(resource_in_use, "the event is registered already");
        *place = std::make_unique<Event>();
        (*place)->stream = dynamic_cast<Stream*>(&find<Module>(source, "module"));
        (*place)->device = dynamic_cast<Device*>(&find<Module>(source, "module"));
        *out = give_out(**place);
    });
}

GENTL_EXPORT Error GCUnregisterEvent(Handle source, int32_t kind) {
    return guarded([&](Lock& lock) {
        std::unique_ptr<Event>* place = event_place(find<Module>(source, "module"), kind);
        if (!place || !*place) fail(invalid_parameter, "the event is not registered");
        close_event(lock, *place);
    });
}

GENTL_EXPORT Error EventGetData(Handle handle, void* out, size_t* size, uint64_t timeout_ms) {
    return guarded([&](Lock& lock) {
        Event& event = find<Event>(handle, "event");
        const Answer answer{nullptr, out, size};
        if (event.device) {
            if (out && required(size) < sizeof(ErrorData)) fail(buffer_too_small, "the event needs 64 bytes");
            const ErrorData data = await_error(lock, event, timeout_ms);
            answer.bytes(0, &data, sizeof data);
            if (out) ++event.fired;
            return;
        }
        Stream& stream = *event.stream;
        stream.before_event();
        if (out && required(size) < sizeof(NewBuffer)) fail(buffer_too_small, "the event needs 16 bytes");
        await_buffer(lock, event, timeout_ms);
        Buffer& buffer = *stream.output.front();
        const NewBuffer data{&buffer, buffer.user};
        answer.bytes(0, &data, sizeof data);
        if (!out) return;
        stream.output.pop_front();
        buffer.state = Buffer::idle;  // now the client's
    });
}

GENTL_EXPORT Error EventGetDataInfo(Handle handle, const void* in, size_t in_size, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        if (find<Event>(handle, "event").device) {
            if (!in || in_size < sizeof(ErrorData)) fail(invalid_parameter, "this is no event's data");
            ErrorData data;
            std::memcpy(&data, in, sizeof data);
            data.text[sizeof data.text - 1] = 0;
            if (what == event_data::id) return ANSWER.i32(data.code);
            if (what == event_data::value) return ANSWER.text(data.text);
            fail(not_implemented, "not known of an event's data");
        }
        if (!in || in_size < sizeof(NewBuffer)) fail(invalid_parameter, "this is no event's data");
        NewBuffer data;
        std::memcpy(&data, in, sizeof data);
        if (what == event_data::id) return ANSWER.pointer(data.buffer);
        if (what == event_data::value) return ANSWER.pointer(data.user);
        fail(not_implemented, "not known of an event's data");
    });
}

GENTL_EXPORT Error EventGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        const Event& event = find<Event>(handle, "event");
        switch (what) {
            case event_info::type: return ANSWER.i32(event.stream ? event_new_buffer : event_error);
            case event_info::in_queue:
                return ANSWER.count(event.stream ? event.stream->output.size() : !event.fired && event.device->lost());
            case event_info::fired: return ANSWER.u64(event.fired);
            case event_info::largest: return ANSWER.count(event.stream ? sizeof(NewBuffer) : sizeof(ErrorData));
            case event_info::largest_info: return ANSWER.count(event.stream ? sizeof(void*) : sizeof(ErrorData::text));
            default: fail(not_implemented, "not known of an event");
        }
    });
}

GENTL_EXPORT Error EventFlush(Handle handle) {
    return guarded([&](Lock&) {
        const Event& event = find<Event>(handle, "event");
        if (event.stream) release(event.stream->output);
    });
}

GENTL_EXPORT Error EventKill(Handle handle) {
    return guarded([&](Lock&) {
        Event& event = find<Event>(handle, "event");
        event.killed = true;
        if (event.stream) event.stream->arrived.notify_all();
        state().back.notify_all();
    });
}

// ---- system and interface -------------------------------------------------------------------------------------------

GENTL_EXPORT Error TLOpen(Handle* out) {
    return guarded([&](Lock&) {
        if (state().system) fail(resource_in_use, "the producer is open already");
        required(out);
        producer().open();
        state().system = std::make_unique<System>();
        *out = give_out(*state().system);
    });
}

GENTL_EXPORT Error TLClose(Handle system) {
    return guarded([&](Lock& lock) { find<System>(system, "producer"), close_all(lock); });
}

GENTL_EXPORT Error TLGetInfo(Handle system, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { find<System>(system, "producer"), about_producer(what, ANSWER); });
}

GENTL_EXPORT Error TLGetNumInterfaces(Handle system, uint32_t* count) {
    return guarded([&](Lock&) {
        find<System>(system, "producer"), required(count) = uint32_t(producer().interfaces.size());
    });
}

GENTL_EXPORT Error TLGetInterfaceID(Handle system, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        if (index >= producer().interfaces.size()) fail(invalid_index, "there are not that many interfaces");
        answer_text(id, size, producer().interfaces[index]->name());
    });
}

GENTL_EXPORT Error TLGetInterfaceInfo(Handle system, const char* id, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { find<System>(system, "producer"), about_interface(find_interface(id), what, ANSWER); });
}

GENTL_EXPORT Error TLOpenInterface(Handle system, const char* id, Handle* out) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        Interface& link = find_interface(id);
        if (link.opened) fail(resource_in_use, "the interface is open already");
        required(out) = give_out(link);
        link.opened = true;
    });
}

GENTL_EXPORT Error TLUpdateInterfaceList(Handle system, uint8_t* changed, uint64_t) {
    return guarded([&](Lock& lock) {
        find<System>(system, "producer");
        const bool any = producer().refresh(lock);
        if (changed) *changed = any;
    });
}

GENTL_EXPORT Error IFClose(Handle handle) {
    return guarded([&](Lock& lock) { close_interface(lock, find<Interface>(handle, "interface")); });
}

GENTL_EXPORT Error IFGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_interface(find<Interface>(handle, "interface"), what, ANSWER); });
}

GENTL_EXPORT Error IFGetParentTL(Handle handle, Handle* out) {
    return guarded([&](Lock&) { find<Interface>(handle, "interface"), required(out) = state().system.get(); });
}

GENTL_EXPORT Error IFUpdateDeviceList(Handle handle, uint8_t* changed, uint64_t timeout_ms) {
    return guarded([&](Lock& lock) {
        const bool any = find<Interface>(handle, "interface").refresh(lock, timeout_ms);
        if (changed) *changed = any;
    });
}

GENTL_EXPORT Error IFGetNumDevices(Handle handle, uint32_t* count) {
    return guarded([&](Lock&) {
        const Interface& link = find<Interface>(handle, "interface");
        required(count) = 0;
        for (const auto& camera : link.cameras) *count += camera->listed;
    });
}

GENTL_EXPORT Error IFGetDeviceID(Handle handle, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        answer_text(id, size, listed_camera(find<Interface>(handle, "interface"), index).id());
    });
}

GENTL_EXPORT Error IFGetDeviceInfo(Handle handle, const char* id, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        about_device(find_camera(find<Interface>(handle, "interface"), id), what, ANSWER);
    });
}

GENTL_EXPORT Error IFOpenDevice(Handle handle, const char* id, int32_t flags, Handle* out) {
    return guarded([&](Lock& lock) {
        Interface& link = find<Interface>(handle, "interface");
        required(out);
        if (!lists(link, id)) link.refresh(lock, search_ms);  // a client may know the id from an earlier run
        Camera& camera = find_camera(find<Interface>(handle, "interface"), id);
        if (camera.opened) fail(resource_in_use, "this program has the camera open already");
        if (flags < access::readonly || flags > access::exclusive)
            fail(invalid_parameter, "there is no such way to open a camera");
        std::unique_ptr<Device> device = camera.open(lock, flags);
        device->readonly = flags == access::readonly;
        give_out(device->remote);
        camera.opened = device.get();
        *out = give_out(*device.release());
    });
}

// ---- device ---------------------------------------------------------------------------------------------------------

GENTL_EXPORT Error DevClose(Handle handle) {
    return guarded([&](Lock& lock) { close_device(lock, find<Device>(handle, "camera")); });
}

GENTL_EXPORT Error DevGetPort(Handle handle, Handle* out) {
    return guarded([&](Lock&) { required(out) = &find<Device>(handle, "camera").remote; });
}

GENTL_EXPORT Error DevGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_device(find<Device>(handle, "camera").camera(), what, ANSWER); });
}

GENTL_EXPORT Error DevGetParentIF(Handle handle, Handle* out) {
    return guarded([&](Lock&) { required(out) = find<Device>(handle, "camera").camera().link; });
}

GENTL_EXPORT Error DevGetNumDataStreams(Handle handle, uint32_t* count) {
    return guarded([&](Lock&) { find<Device>(handle, "camera"), required(count) = 1; });
}

GENTL_EXPORT Error DevGetDataStreamID(Handle handle, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        const Device& device = find<Device>(handle, "camera");
        if (index != 0) fail(invalid_index, "a camera has one stream");
        answer_text(id, size, device.camera().id() + "-stream");
    });
}

GENTL_EXPORT Error DevOpenDataStream(Handle handle, const char* id, Handle* out) {
    return guarded([&](Lock&) {
        Device& device = find<Device>(handle, "camera");
        if (std::string(&required(id)) != device.camera().id() + "-stream")
            fail(invalid_id, "there is no such stream");
        if (device.stream) fail(resource_in_use, "the stream is open already");
        if (device.lost()) fail(io_error, "the camera does not answer");
        device.stream = device.make_stream();
        required(out) = give_out(*device.stream);
    });
}

// ---- data stream ----------------------------------------------------------------------------------------------------

GENTL_EXPORT Error DSClose(Handle handle) {
    return guarded([&](Lock& lock) { close_stream(lock, find<Stream>(handle, "stream").owner); });
}

GENTL_EXPORT Error DSGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock& lock) { about_stream(lock, find<Stream>(handle, "stream"), what, ANSWER); });
}

GENTL_EXPORT Error DSGetParentDev(Handle handle, Handle* out) {
    return guarded([&](Lock&) { required(out) = &find<Stream>(handle, "stream").owner; });
}

GENTL_EXPORT Error DSAnnounceBuffer(Handle handle, void* memory, size_t size, void* user, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (!memory || size == 0) fail(invalid_parameter, "a buffer needs memory");
        auto buffer = std::make_unique<Buffer>();
        buffer->memory = static_cast<uint8_t*>(memory), buffer->size = size, buffer->user = user;
        required(out) = announce(stream, std::move(buffer));
    });
}

GENTL_EXPORT Error DSAllocAndAnnounceBuffer(Handle handle, size_t size, void* user, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (size == 0) fail(invalid_parameter, "a buffer needs memory");
        auto buffer = std::make_unique<Buffer>();
        buffer->own = std::make_unique<uint8_t[]>(size);
        buffer->memory = buffer->own.get(), buffer->size = size, buffer->user = user;
        required(out) = announce(stream, std::move(buffer));
    });
}

GENTL_EXPORT Error DSRevokeBuffer(Handle handle, Handle buffer_handle, void** memory, void** user) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        Buffer& buffer = find_buffer(stream, buffer_handle);
        if (buffer.state != Buffer::idle) fail(busy, "a queued buffer cannot be revoked");
        if (memory) *memory = buffer.own ? nullptr : buffer.memory;
        if (user) *user = buffer.user;
        take_back(buffer);
        const auto here = std::find_if(stream.buffers.begin(), stream.buffers.end(),
                                       [&](const auto& b) { return b.get() == &buffer; });
        stream.buffers.erase(here);
    });
}

GENTL_EXPORT Error DSQueueBuffer(Handle handle, Handle buffer) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        queue_buffer(stream, find_buffer(stream, buffer));
    });
}

GENTL_EXPORT Error DSFlushQueue(Handle handle, int32_t how) {
    return guarded([&](Lock& lock) { flush_queues(lock, find<Stream>(handle, "stream"), how); });
}

GENTL_EXPORT Error DSGetBufferID(Handle handle, uint32_t index, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (index >= stream.buffers.size()) fail(invalid_index, "there are not that many buffers");
        required(out) = stream.buffers[index].get();
    });
}

GENTL_EXPORT Error DSGetBufferInfo(Handle handle, Handle buffer, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        about_buffer(stream, find_buffer(stream, buffer), what, ANSWER);
    });
}

GENTL_EXPORT Error DSGetBufferChunkData(Handle handle, Handle buffer, void*, size_t* count) {
    return guarded([&](Lock&) { find_buffer(find<Stream>(handle, "stream"), buffer), required(count) = 0; });
}

GENTL_EXPORT Error DSGetNumBufferParts(Handle handle, Handle buffer, uint32_t* count) {
    return guarded([&](Lock&) {
        required(count) = uint32_t(find_buffer(find<Stream>(handle, "stream"), buffer).parts.size());
    });
}

inline void about_part(const Buffer& buffer, uint32_t index, int32_t what, const Answer& answer) {
    namespace info = part_info;
    if (index >= buffer.parts.size()) fail(not_available, "there are not that many parts");
    switch (what) {
        case info::base: return answer.pointer(buffer.memory);
        case info::data_size: return answer.count(buffer.filled);
        case info::data_type: return answer.count(1);  // an image
        case info::format: return answer.u64(buffer.parts[index]);
        case info::format_namespace: return answer.u64(namespace_pfnc32);
        case info::width: return answer.count(buffer.width);
        case info::height: return answer.count(buffer.height);
        case info::x_offset: return answer.count(buffer.x);
        case info::y_offset: return answer.count(buffer.y);
        case info::x_padding: return answer.count(buffer.padding);
        case info::delivered_height: return answer.count(buffer.delivered_height);
        default: fail(not_available, "not known of a part");
    }
}

GENTL_EXPORT Error DSGetBufferPartInfo(Handle handle, Handle buffer, uint32_t index, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        about_part(find_buffer(find<Stream>(handle, "stream"), buffer), index, what, ANSWER);
    });
}

GENTL_EXPORT Error DSStartAcquisition(Handle handle, int32_t, uint64_t frames) {
    return guarded([&](Lock& lock) {
        Stream& stream = find<Stream>(handle, "stream");
        if (stream.running || stream.changing) fail(resource_in_use, "the stream runs already");
        if (stream.owner.lost()) fail(io_error, "the camera does not answer");
        stream.delivered = stream.underrun = stream.started = 0;
        stream.changing = true;
        try {
            stream.start(lock, frames);
            stream.running = true;
        } catch (...) {
            stream.changing = false;
            state().back.notify_all();
            throw;
        }
        stream.changing = false;
        state().back.notify_all();
    });
}

GENTL_EXPORT Error DSStopAcquisition(Handle handle, int32_t) {
    return guarded([&](Lock& lock) {
        Stream& stream = find<Stream>(handle, "stream");
        if (!stream.running) fail(resource_in_use, "the stream does not run");
        stop_stream(lock, stream);
    });
}

// ---- GenTL 1.6: consumers complain on their screens where these are missing -----------------------------------------

GENTL_EXPORT Error DSAnnounceCompositeBuffer(Handle stream, size_t count, void** parts, size_t* sizes, void* user,
                                             Handle* out) {
    if (count == 1 && parts && sizes) return DSAnnounceBuffer(stream, parts[0], sizes[0], user, out);
    return guarded([](Lock&) { fail(not_implemented, "a buffer has one part of memory here"); });
}

GENTL_EXPORT Error DSGetBufferInfoStacked(Handle handle, Handle buffer_handle, BufferInfoEntry* entries, size_t count) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        Buffer& buffer = find_buffer(stream, buffer_handle);
        if (count) required(entries);
        for (size_t i = 0; i < count; ++i) {
            BufferInfoEntry entry = entries[i];  // the caller's are not aligned
            entry.result = success;
            try {
                about_buffer(stream, buffer, entry.what, Answer{&entry.type, entry.out, &entry.size});
            } catch (const Failure& failure) {
                entry.result = remember(failure.code, failure.text);
            }
            entries[i] = entry;
        }
    });
}

GENTL_EXPORT Error DSGetBufferPartInfoStacked(Handle handle, Handle buffer, void*, size_t) {
    return guarded([&](Lock&) {
        find_buffer(find<Stream>(handle, "stream"), buffer);
        fail(not_available, "a frame here has one part only");
    });
}

GENTL_EXPORT Error DSGetNumFlows(Handle, uint32_t*) {
    return guarded([](Lock&) { fail(not_implemented, "there are no flows here"); });
}

GENTL_EXPORT Error DSGetFlowInfo(Handle, uint32_t, INFO_ARGUMENTS) {
    (void)what, (void)type, (void)out, (void)size;
    return guarded([](Lock&) { fail(not_implemented, "there are no flows here"); });
}

GENTL_EXPORT Error DSGetNumBufferSegments(Handle, Handle, uint32_t*) {
    return guarded([](Lock&) { fail(not_implemented, "there are no composite buffers here"); });
}

GENTL_EXPORT Error DSGetBufferSegmentInfo(Handle, Handle, uint32_t, INFO_ARGUMENTS) {
    (void)what, (void)type, (void)out, (void)size;
    return guarded([](Lock&) { fail(not_implemented, "there are no composite buffers here"); });
}

}  // namespace gentl
