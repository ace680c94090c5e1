// What every GenTL producer here shares: errors, answers, handles, modules, buffers, queues and events.
//
// A transport derives from Producer, Interface, Camera, Device and Stream; gentl_exports.h turns them into the exported
// functions. One lock guards everything. Whatever takes time (a register over a network, a search) happens inside Away,
// which gives the lock back meanwhile and keeps the device from being closed.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <unordered_map>
#include <vector>

#include "gentl_abi.h"

namespace gentl {

using Clock = std::chrono::steady_clock;
using Lock = std::unique_lock<std::mutex>;
using std::chrono::milliseconds;

// ---- errors ---------------------------------------------------------------------------------------------------------

struct Failure {
    Error code;
    std::string text;
};

inline std::string (*error_tail)() = nullptr;  // what simulated cameras put behind every text of an error

inline Failure& last_failure() {
    thread_local Failure kept{success, "no error"};
    return kept;
}

inline Error remember(Error code, const std::string& text) {
    last_failure() = {code, text};
    return code;
}

[[noreturn]] inline void fail(Error code, const std::string& text) { throw Failure{code, text}; }

template <class T>
T& required(T* pointer) {
    if (!pointer) fail(invalid_parameter, "a required pointer is null");
    return *pointer;
}

// ---- answers to the GetInfo functions -------------------------------------------------------------------------------

struct Answer {
    int32_t* type;
    void* out;
    size_t* size;

    void bytes(int32_t kind, const void* data, size_t n) const {
        required(size);
        if (type) *type = kind;
        if (out && *size < n) fail(buffer_too_small, "the buffer is too small for the answer");
        if (out) std::memcpy(out, data, n);
        *size = n;
    }
    void text(const std::string& s) const { bytes(datatype::text, s.c_str(), s.size() + 1); }
    void flag(bool on) const { number<uint8_t>(datatype::flag, on); }
    void i32(int32_t v) const { number(datatype::i32, v); }
    void u32(uint32_t v) const { number(datatype::u32, v); }
    void u64(uint64_t v) const { number(datatype::u64, v); }
    void count(size_t v) const { number(datatype::size, v); }
    void pointer(void* v) const { number(datatype::pointer, v); }

   private:
    template <class T>
    void number(int32_t kind, T v) const { bytes(kind, &v, sizeof v); }
};

inline void answer_text(char* out, size_t* size, const std::string& s) { Answer{nullptr, out, size}.text(s); }

// ---- modules --------------------------------------------------------------------------------------------------------

struct Device;
struct Event;
struct Interface;
struct Stream;

// A feature of a module other than the camera itself. Its place in the list is its address: feature_bytes each.
struct Feature {
    const char* name;
    std::function<std::string()> text;        // a text, or
    std::function<int64_t()> number;          // a number, and
    std::function<void(int64_t)> write;       // where it can be written
    bool command = false;

    static Feature say(const char* name, std::function<std::string()> text) { return {name, std::move(text), {}, {}}; }
    static Feature count(const char* name, std::function<int64_t()> number, std::function<void(int64_t)> write = {}) {
        return {name, {}, std::move(number), std::move(write)};
    }
    static Feature run(const char* name, std::function<void(int64_t)> act) {
        return {name, {}, {}, std::move(act), true};
    }
};

constexpr uint64_t feature_bytes = 64;

struct Module {
    virtual ~Module() = default;
    virtual const char* kind() const = 0;
    virtual std::string name() const = 0;
    virtual std::vector<Feature> features() {
        return {Feature::say("ModuleID", [this] { return name(); })};
    }
};

struct System : Module {
    const char* kind() const override { return "TLSystem"; }
    std::string name() const override;
    std::vector<Feature> features() override;
};

struct Camera {  // one that was found; it exists whether a client has it open or not
    Interface* link = nullptr;
    Device* opened = nullptr;
    bool listed = false;

    virtual ~Camera() = default;
    virtual std::string id() const = 0;
    virtual std::string vendor() const = 0;
    virtual std::string model() const = 0;
    virtual std::string serial() const = 0;
    virtual std::string user_name() const { return ""; }
    virtual std::string version() const { return ""; }
    virtual std::string type() const = 0;
    virtual std::string display_name() const { return vendor() + " " + model() + " (" + serial() + ")"; }
    virtual uint64_t timestamp_frequency() const { return 1000000000; }
    virtual int32_t access_status() const = 0;
    virtual void before_asked() {}
    // May go Away; fails where the camera cannot be opened so.
    virtual std::unique_ptr<Device> open(Lock&, int32_t how) = 0;
};

struct Interface : Module {
    bool opened = false;
    std::vector<std::unique_ptr<Camera>> cameras;

    const char* kind() const override { return "TLInterface"; }
    virtual std::string display_name() const = 0;
    virtual std::string type() const = 0;
    // Whether the list of cameras changed; may go Away.
    virtual bool refresh(Lock&, uint64_t timeout_ms) = 0;
};

struct RemotePort : Module {
    Device* device = nullptr;
    const char* kind() const override { return "Device"; }
    std::string name() const override;
};

struct Device : Module {
    bool readonly = false;
    unsigned away = 0;  // calls that gave the lock back for a while
    RemotePort remote;
    std::unique_ptr<Stream> stream;
    std::unique_ptr<Event> errors;

    Device();
    ~Device() override;
    const char* kind() const override { return "TLDevice"; }
    std::string name() const override { return camera().id(); }
    virtual Camera& camera() const = 0;
    virtual bool lost() const = 0;
    virtual bool big_endian() const { return false; }
    virtual std::string xml() = 0;
    virtual std::string xml_name() const { return "spherecal_camera.xml"; }
    virtual std::string xml_url() const { return ""; }  // where the description is not in the camera
    virtual std::unique_ptr<Stream> make_stream() = 0;
    // The camera's own registers.
    virtual void read(Lock&, uint64_t at, void* out, size_t size) = 0;
    virtual void write(Lock&, uint64_t at, const void* data, size_t size) = 0;
    virtual void before_close(Lock&) {}
};

inline std::string RemotePort::name() const { return device->name(); }

struct Buffer : Module {
    enum State { idle, queued, filling, done };
    uint8_t* memory = nullptr;
    std::unique_ptr<uint8_t[]> own;
    size_t size = 0, filled = 0, missing_packets = 0;
    void* user = nullptr;
    State state = idle;
    bool incomplete = false, too_small = false, fresh = false, ever_filled = false, chunks = false, big_endian = false;
    uint32_t width = 0, height = 0, x = 0, y = 0, format = 0, padding = 0, delivered_height = 0;
    size_t payload = payload_is_image;
    uint64_t frame_id = 0, timestamp_ns = 0;
    std::vector<uint32_t> parts;  // pixel formats of the parts, each the whole image; empty where it is one image
    const char* kind() const override { return "TLBuffer"; }
    std::string name() const override { return "buffer"; }
};

struct Event : Module {  // new buffers of a stream, or the errors of a device
    Stream* stream = nullptr;
    Device* device = nullptr;
    uint64_t fired = 0;
    uint32_t waiting = 0;
    bool killed = false, closing = false;
    const char* kind() const override { return "event"; }
    std::string name() const override { return stream ? "new buffer" : "error"; }
};

struct Stream : Module {
    Device& owner;
    std::vector<std::unique_ptr<Buffer>> buffers;
    std::deque<Buffer*> input, output;
    std::unique_ptr<Event> event;
    std::condition_variable arrived;
    bool running = false, changing = false;  // changing: starting or stopping, the lock given back meanwhile
    uint64_t delivered = 0, underrun = 0, started = 0;

    explicit Stream(Device& device) : owner(device) {}
    const char* kind() const override { return "TLDataStream"; }
    std::string name() const override { return owner.camera().id() + "-stream"; }
    virtual size_t payload_size(Lock&) = 0;
    virtual size_t waiting() const { return output.size(); }
    virtual size_t least_buffers() const { return 1; }
    virtual uint64_t frames_lost() const { return underrun; }
    virtual void start(Lock&, uint64_t frames) = 0;
    virtual void stop(Lock&) = 0;  // afterwards every buffer is in a queue or the client's
    virtual void queued(Buffer& buffer) { input.push_back(&buffer); }
    virtual void give_input_back(Lock&) {}  // what a running transport keeps of the queued goes into `input`
    virtual void before_event() {}
};

inline Device::Device() { remote.device = this; }
inline Device::~Device() = default;

struct Producer {
    std::vector<std::unique_ptr<Interface>> interfaces;

    virtual ~Producer() = default;
    virtual const char* id() const = 0;
    virtual const char* model() const = 0;
    virtual const char* type() const = 0;
    virtual const char* display_name() const = 0;
    virtual void open() = 0;  // makes the interfaces
    virtual void close() = 0;
    virtual bool refresh(Lock&) { return false; }  // whether the list of interfaces changed
    virtual std::vector<Feature> features() { return {}; }
};

constexpr const char* vendor = "SphereCal";
constexpr const char* version = "1.0.0";

Producer& producer();  // each transport's own

struct State {
    std::mutex mutex;
    std::condition_variable back;  // somebody is no longer Away
    bool initialised = false;
    std::unique_ptr<System> system;
    std::unordered_map<Handle, Module*> live;  // every handle given out and not taken back
};

inline State& state() {
    static State& kept = *new State;  // never destroyed: threads may outlive main()
    return kept;
}

inline std::string System::name() const { return producer().id(); }

inline std::vector<Feature> System::features() {
    std::vector<Feature> all = producer().features();
    all.insert(all.begin(), Module::features().front());
    return all;
}

template <class T>
T& find(Handle handle, const char* what) {
    const auto found = state().live.find(handle);
    T* module = found == state().live.end() ? nullptr : dynamic_cast<T*>(found->second);
    if (!module) fail(invalid_handle, std::string("this is no handle of an open ") + what);
    return *module;
}

inline Handle give_out(Module& module) {
    state().live[&module] = &module;
    return &module;
}

inline void take_back(Module& module) { state().live.erase(&module); }

// The lock is given back while this lives; the device is not closed meanwhile.
class Away {
   public:
    Away(Lock& lock, Device& device) : lock_(lock), device_(device) {
        ++device_.away;
        lock_.unlock();
    }
    ~Away() {
        lock_.lock();
        --device_.away;
        state().back.notify_all();
    }
    Away(const Away&) = delete;

   private:
    Lock& lock_;
    Device& device_;
};

// ---- descriptions and ports -----------------------------------------------------------------------------------------

// The descriptions are read from here on. GigE Vision's registers have 32 bit addresses; nothing of a camera is here.
constexpr uint64_t xml_address = 0x7F0000000000ull;

inline std::string feature_xml(const Feature& feature, uint64_t at, const std::string& port) {
    const std::string name = feature.name, where = "<Address>" + std::to_string(at) + "</Address><Length>";
    const std::string access = feature.command ? "WO" : feature.write ? "RW" : "RO";
    const std::string rest = "</Length><AccessMode>" + access + "</AccessMode><pPort>" + port +
                             "</pPort><Cachable>NoCache</Cachable>";
    if (feature.text) return "<StringReg Name=\"" + name + "\">" + where + "64" + rest + "</StringReg>";
    const std::string reg = "<IntReg Name=\"" + name + "Reg\">" + where + "8" + rest +
                            "<Sign>Signed</Sign><Endianess>LittleEndian</Endianess></IntReg>";
    if (feature.command)
        return "<Command Name=\"" + name + "\"><pValue>" + name + "Reg</pValue><CommandValue>1</CommandValue></Command>" +
               reg;
    return "<Integer Name=\"" + name + "\"><pValue>" + name + "Reg</pValue></Integer>" + reg;
}

inline std::string module_xml(Module& module) {
    const std::string kind = module.kind();
    std::string categories, nodes;
    uint64_t at = 0;
    for (const Feature& feature : module.features()) {
        categories += std::string("<pFeature>") + feature.name + "</pFeature>";
        nodes += feature_xml(feature, at, kind);
        at += feature_bytes;
    }
    return "<?xml version=\"1.0\" encoding=\"utf-8\"?><RegisterDescription ModelName=\"" + kind +
           "\" VendorName=\"SphereCal\" ToolTip=\"\" StandardNameSpace=\"None\" SchemaMajorVersion=\"1\" "
           "SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" MinorVersion=\"0\" "
           "SubMinorVersion=\"0\" ProductGuid=\"0f4b35a5-3b1c-4f5e-9d4b-6c6f6f3b2a01\" "
           "VersionGuid=\"e6f3f0b6-6f0f-4f9f-8a7e-31b0c8b1a902\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\" "
           "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
           "xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1 "
           "http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd\">"
           "<Category Name=\"Root\">" + categories + "</Category>" + nodes + "<Port Name=\"" + kind +
           "\"/></RegisterDescription>";
}

inline std::string xml_of(Module& module) {
    auto* remote = dynamic_cast<RemotePort*>(&module);
    return remote ? remote->device->xml() : module_xml(module);
}

inline std::string url_of(Module& module) {
    auto* remote = dynamic_cast<RemotePort*>(&module);
    if (remote && !remote->device->xml_url().empty()) return remote->device->xml_url();
    char numbers[48];
    std::snprintf(numbers, sizeof numbers, "%llX;%llX", static_cast<unsigned long long>(xml_address),
                  static_cast<unsigned long long>(xml_of(module).size()));
    const std::string name = remote ? remote->device->xml_name() : std::string("spherecal_") + module.kind() + ".xml";
    return "local:" + name + ";" + numbers;
}

inline Module& find_port(Handle handle) {
    Module& module = find<Module>(handle, "port");
    if (dynamic_cast<Event*>(&module) || dynamic_cast<Buffer*>(&module))
        fail(invalid_handle, "events and buffers have no port here");
    return module;
}

inline void read_text(const std::string& text, uint64_t from, void* out, size_t size) {
    std::memset(out, 0, size);
    if (from < text.size()) std::memcpy(out, text.data() + from, std::min<size_t>(size, text.size() - from));
}

inline Feature feature_at(Module& module, uint64_t at) {
    std::vector<Feature> all = module.features();
    if (at / feature_bytes >= all.size()) fail(invalid_address, "there is no register at this address");
    return all[size_t(at / feature_bytes)];
}

inline void read_feature(Module& module, uint64_t at, void* out, size_t size) {
    const Feature feature = feature_at(module, at);
    if (feature.text) return read_text(feature.text().substr(0, feature_bytes - 1), at % feature_bytes, out, size);
    if (!feature.number) fail(access_denied, "a command has no value");
    const int64_t value = feature.number();
    read_text(std::string(reinterpret_cast<const char*>(&value), sizeof value), at % feature_bytes, out, size);
}

inline void write_feature(Module& module, uint64_t at, const void* data, size_t size) {
    const Feature feature = feature_at(module, at);
    if (!feature.write || at % feature_bytes || size > 8) fail(access_denied, "this module has nothing to write there");
    int64_t value = 0;
    std::memcpy(&value, data, size);
    feature.write(value);
}

inline void read_port(Lock& lock, Handle handle, uint64_t at, void* out, size_t size) {
    if (!out) fail(invalid_parameter, "there is no place for the answer");
    Module& module = find_port(handle);
    auto* remote = dynamic_cast<RemotePort*>(&module);
    if (at >= xml_address) {
        if (remote && remote->device->lost()) fail(io_error, "the camera does not answer");
        return read_text(xml_of(module), at - xml_address, out, size);
    }
    if (remote) return remote->device->read(lock, at, out, size);
    read_feature(module, at, out, size);
}

inline void write_port(Lock& lock, Handle handle, uint64_t at, const void* data, size_t size) {
    if (!data) fail(invalid_parameter, "there is nothing to write");
    Module& module = find_port(handle);
    auto* remote = dynamic_cast<RemotePort*>(&module);
    if (!remote) return write_feature(module, at, data, size);
    if (remote->device->readonly) fail(access_denied, "the camera was opened for reading only");
    remote->device->write(lock, at, data, size);
}

// ---- opening and closing --------------------------------------------------------------------------------------------

inline void stop_stream(Lock& lock, Stream& stream) {
    while (stream.changing) state().back.wait(lock);
    if (!stream.running) return;
    stream.changing = true;
    stream.stop(lock);
    stream.running = stream.changing = false;
    state().back.notify_all();
}

inline void close_event(Lock& lock, std::unique_ptr<Event>& event) {
    if (!event) return;
    event->closing = true;
    if (event->stream) event->stream->arrived.notify_all();
    state().back.notify_all();
    while (event->waiting > 0) state().back.wait_for(lock, milliseconds(1));
    take_back(*event);
    event.reset();
}

inline void close_stream(Lock& lock, Device& device) {
    if (!device.stream) return;
    Stream& stream = *device.stream;
    stop_stream(lock, stream);
    close_event(lock, stream.event);
    for (const auto& buffer : stream.buffers) take_back(*buffer);
    take_back(stream);
    while (device.away > 0) state().back.wait(lock);
    device.stream.reset();
}

inline void close_device(Lock& lock, Device& device) {
    take_back(device.remote);
    take_back(device);
    close_stream(lock, device);
    close_event(lock, device.errors);
    while (device.away > 0) state().back.wait(lock);
    device.before_close(lock);
    device.camera().opened = nullptr;
    delete &device;
}

inline void close_interface(Lock& lock, Interface& link) {
    for (size_t i = 0; i < link.cameras.size(); ++i)
        if (link.cameras[i]->opened) close_device(lock, *link.cameras[i]->opened);
    take_back(link);
    link.opened = false;
}

inline void close_all(Lock& lock) {
    for (size_t i = 0; i < producer().interfaces.size(); ++i) close_interface(lock, *producer().interfaces[i]);
    if (state().system) producer().close();
    producer().interfaces.clear();
    state().system.reset();
    state().live.clear();
}

// ---- buffers and queues ---------------------------------------------------------------------------------------------

inline Handle announce(Stream& stream, std::unique_ptr<Buffer> buffer) {
    stream.buffers.push_back(std::move(buffer));
    return give_out(*stream.buffers.back());
}

inline Buffer& find_buffer(Stream& stream, Handle handle) {
    for (const auto& buffer : stream.buffers)
        if (buffer.get() == handle) return *buffer;
    fail(invalid_buffer, "this buffer is not announced to this stream");
}

inline void queue_buffer(Stream& stream, Buffer& buffer) {
    if (buffer.state != Buffer::idle) fail(resource_in_use, "this buffer is queued already");
    buffer.state = Buffer::queued;
    buffer.filled = 0;
    stream.queued(buffer);
}

inline void deliver(Stream& stream, Buffer& buffer) {
    buffer.state = Buffer::done;
    buffer.fresh = buffer.ever_filled = true;
    stream.output.push_back(&buffer);
    ++stream.delivered;
    if (stream.event) ++stream.event->fired;
    stream.arrived.notify_all();
}

inline void release(std::deque<Buffer*>& queue) {
    for (Buffer* buffer : queue) buffer->state = Buffer::idle;
    queue.clear();
}

inline void flush_queues(Lock& lock, Stream& stream, int32_t how) {
    if (how == flush::input_to_output || how == flush::discard_all) stream.give_input_back(lock);
    switch (how) {
        case flush::input_to_output:
            for (Buffer* buffer : stream.input) {
                buffer->state = Buffer::done;
                stream.output.push_back(buffer);
            }
            stream.input.clear();
            stream.arrived.notify_all();
            return;
        case flush::discard_output: return release(stream.output);
        case flush::all_to_input:
            release(stream.output);
            [[fallthrough]];
        case flush::unqueued_to_input:
            for (const auto& buffer : stream.buffers)
                if (buffer->state == Buffer::idle) queue_buffer(stream, *buffer);
            return;
        case flush::discard_all:
            release(stream.input);
            return release(stream.output);
        default: fail(invalid_parameter, "there is no such way to flush");
    }
}

inline void await_buffer(Lock& lock, Event& event, uint64_t timeout_ms) {
    Stream& stream = *event.stream;
    const auto ready = [&] { return !stream.output.empty() || event.killed || event.closing; };
    ++event.waiting;
    if (timeout_ms > 86400000ull)
        stream.arrived.wait(lock, ready);
    else if (timeout_ms > 0)
        stream.arrived.wait_for(lock, milliseconds(timeout_ms), ready);
    --event.waiting;
    if (event.killed || event.closing) {
        event.killed = false;
        fail(aborted, "waiting was ended");
    }
    if (stream.output.empty()) fail(timeout, "no buffer has arrived in time");
}

constexpr milliseconds look_for_loss_each{50};

// A device that is lost says so once.
inline ErrorData await_error(Lock& lock, Event& event, uint64_t timeout_ms) {
    const auto until = Clock::now() + milliseconds(std::min<uint64_t>(timeout_ms, 86400000ull));
    const bool for_ever = timeout_ms > 86400000ull;
    const auto ready = [&] { return (!event.fired && event.device->lost()) || event.killed || event.closing; };
    ++event.waiting;
    while (!ready() && (for_ever || Clock::now() < until)) state().back.wait_for(lock, look_for_loss_each);
    --event.waiting;
    if (event.killed || event.closing) {
        event.killed = false;
        fail(aborted, "waiting was ended");
    }
    if (!ready()) fail(timeout, "no error has happened in time");
    return {io_error, "the camera does not answer"};
}

}  // namespace gentl
