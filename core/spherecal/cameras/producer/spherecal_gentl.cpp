// A GenTL producer (.cti) of simulated cameras for tests and training: no hardware, the whole real software path.
//
// The cameras live in a shared memory region that control.py makes (region.h); without one there are twelve cameras
// that show a moving pattern. One lock guards everything; each stream has one thread that exposes and delivers frames.
// README.md says what the cameras do, and which faults can be asked of them.

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <thread>
#include <unordered_map>

#if defined(_WIN32)
#define NOMINMAX
#include <windows.h>
#else
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#endif
#if defined(__linux__)
#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#endif

#include "device_xml.h"  // made by build.py from device.xml: `device_xml`, the text
#include "gentl_abi.h"
#include "pixels.h"
#include "region.h"

namespace {

using gentl::Error;
using gentl::Handle;
using Clock = std::chrono::steady_clock;
using Lock = std::unique_lock<std::mutex>;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr const char* vendor = "SphereCal";
constexpr const char* version = "1.0.0";
constexpr const char* producer_id = "spherecal-simulated";
constexpr const char* interface_name = "spherecal-simulated-link";
constexpr const char* transport = "Custom";
constexpr uint64_t xml_address = 0x100000;
constexpr double line_s = 2.44e-6;  // what the sensor's readout takes for a line: 5 ms for 2048
const nanoseconds no_time = nanoseconds::max();

nanoseconds now() { return Clock::now().time_since_epoch(); }
nanoseconds seconds(double s) { return nanoseconds(int64_t(s * 1e9)); }

// ---- errors ---------------------------------------------------------------------------------------------------------

struct Failure {
    Error code;
    std::string text;
};

thread_local Failure last_failure{gentl::success, "no error"};

Error remember(Error code, const std::string& text) {
    last_failure = {code, text};
    return code;
}

[[noreturn]] void fail(Error code, const std::string& text) { throw Failure{code, text}; }

template <class T>
T& required(T* pointer) {
    if (!pointer) fail(gentl::invalid_parameter, "a required pointer is null");
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
        if (out && *size < n) fail(gentl::buffer_too_small, "the buffer is too small for the answer");
        if (out) std::memcpy(out, data, n);
        *size = n;
    }
    void text(const std::string& s) const { bytes(gentl::datatype::text, s.c_str(), s.size() + 1); }
    void flag(bool on) const { number<uint8_t>(gentl::datatype::flag, on); }
    void i32(int32_t v) const { number(gentl::datatype::i32, v); }
    void u32(uint32_t v) const { number(gentl::datatype::u32, v); }
    void u64(uint64_t v) const { number(gentl::datatype::u64, v); }
    void count(size_t v) const { number(gentl::datatype::size, v); }
    void pointer(void* v) const { number(gentl::datatype::pointer, v); }

   private:
    template <class T>
    void number(int32_t kind, T v) const { bytes(kind, &v, sizeof v); }
};

void answer_text(char* out, size_t* size, const std::string& s) { Answer{nullptr, out, size}.text(s); }

// ---- the shared region ----------------------------------------------------------------------------------------------

class Mapping {
   public:
    static std::unique_ptr<Mapping> open(const std::string& name) {
        auto mapping = std::unique_ptr<Mapping>(new Mapping);
        return mapping->map(name) ? std::move(mapping) : nullptr;
    }
    Mapping(const Mapping&) = delete;
    uint8_t* data() const { return static_cast<uint8_t*>(data_); }
    uint64_t size() const { return size_; }

#if defined(_WIN32)
    ~Mapping() {
        if (data_) UnmapViewOfFile(data_);
        if (file_) CloseHandle(file_);
    }

   private:
    Mapping() = default;
    bool map(const std::string& name) {
        file_ = OpenFileMappingA(FILE_MAP_ALL_ACCESS, FALSE, name.c_str());
        if (file_) data_ = MapViewOfFile(file_, FILE_MAP_ALL_ACCESS, 0, 0, 0);
        MEMORY_BASIC_INFORMATION about;
        if (!data_ || !VirtualQuery(data_, &about, sizeof about)) return false;
        size_ = about.RegionSize;
        return true;
    }
    HANDLE file_ = nullptr;
#else
    ~Mapping() {
        if (data_) munmap(data_, size_);
    }

   private:
    Mapping() = default;
    bool map(const std::string& name) {
        const int file = shm_open(("/" + name).c_str(), O_RDWR | O_CLOEXEC, 0);
        if (file < 0) return false;
        struct stat about {};
        // one of another user may be there to show us pictures of his choice
        if (fstat(file, &about) == 0 && about.st_uid == geteuid() && about.st_size > 0) {
            void* data = mmap(nullptr, size_t(about.st_size), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
            if (data != MAP_FAILED) data_ = data, size_ = uint64_t(about.st_size);
        }
        close(file);
        return data_ != nullptr;
    }
#endif
    void* data_ = nullptr;
    uint64_t size_ = 0;
};

bool take(region::I32& count) {  // one of the next n times, or any time
    const int32_t left = count.load();
    if (left > 0) count.fetch_sub(1);
    return left != 0;
}

void crash_if_asked(region::Device& device) {  // as vendors' libraries do now and then
    if (take(device.crash_count)) std::raise(SIGSEGV);
}

void copy_name(char* out, size_t size, const std::string& name) {
    std::memset(out, 0, size);
    std::memcpy(out, name.data(), std::min(name.size(), size - 1));
}

struct Rig {
    std::unique_ptr<Mapping> mapping;
    std::unique_ptr<region::Device[]> own;  // without a region
    region::Header* header = nullptr;
    region::Device* devices = nullptr;
    uint32_t count = 0;

    region::Device& device(uint32_t i) { return devices[i]; }
    const uint8_t* slot(uint32_t device, uint64_t image) const {
        return mapping->data() + region::images_at + (device * 2 + (image & 1)) * header->slot_bytes;
    }

    void open() {
        const char* named = std::getenv("SPHERECAL_GENTL_REGION");
        const bool asked = named && *named;
        if (asked && std::string(named) == "-") return make_own();
        mapping = Mapping::open(asked ? named : default_name());
        if (mapping)
            adopt();
        else if (asked)
            fail(gentl::not_available, std::string("there is no shared memory region ") + named);
        else
            make_own();
    }

    void close() {
        own.reset();
        mapping.reset();
        header = nullptr, devices = nullptr, count = 0;
    }

   private:
    static std::string default_name() {
#if defined(_WIN32)
        return "spherecal-gentl";
#else
        return "spherecal-gentl-" + std::to_string(getuid());
#endif
    }

    void adopt() {
        header = reinterpret_cast<region::Header*>(mapping->data());
        if (mapping->size() < region::images_at || header->magic != region::magic ||
            header->layout_version != region::layout_version || header->total_bytes > mapping->size())
            fail(gentl::not_available, "the shared memory region is of another version of the simulated producer");
        devices = reinterpret_cast<region::Device*>(mapping->data() + region::page);
        count = std::min(header->device_count, region::most_devices);
    }

    void make_own() {
        const char* wanted = std::getenv("SPHERECAL_GENTL_DEVICES");
        const long n = wanted ? std::strtol(wanted, nullptr, 10) : 12;
        count = uint32_t(std::min(std::max(n, 1L), long(region::most_devices)));
        own = std::make_unique<region::Device[]>(count);
        devices = own.get();
        for (uint32_t i = 0; i < count; ++i) {
            const std::string number = std::string(i < 9 ? "0" : "") + std::to_string(i + 1);
            copy_name(devices[i].serial, sizeof devices[i].serial, "SIM" + number);
            copy_name(devices[i].user_id, sizeof devices[i].user_id, "");
            copy_name(devices[i].model, sizeof devices[i].model, "Simulated 5M");
            devices[i].sensor_width = 2448, devices[i].sensor_height = 2048;
            devices[i].source_bits = 8;
            devices[i].temperature_c = 41.5;
        }
    }
};

// ---- modules --------------------------------------------------------------------------------------------------------

struct Stream;
struct Device;

struct Module {
    virtual ~Module() = default;
    virtual const char* kind() const = 0;
    virtual std::string name() const = 0;
};

struct System : Module {
    const char* kind() const override { return "TLSystem"; }
    std::string name() const override { return producer_id; }
};

struct Interface : Module {
    const char* kind() const override { return "TLInterface"; }
    std::string name() const override { return interface_name; }
};

struct Camera {  // one of the rig; it exists whether a client has it open or not
    uint32_t index = 0;
    region::Device* block = nullptr;
    bool listed = false;
    Device* opened = nullptr;

    bool unplugged() const { return uint64_t(now().count()) < block->unplugged_until_ns; }
    std::string serial() const { return std::string(block->serial, strnlen(block->serial, sizeof block->serial)); }
    std::string id() const { return "SphereCal-" + serial(); }
    std::string model() const { return std::string(block->model, strnlen(block->model, sizeof block->model)); }
};

struct RemotePort : Module {
    Device* device = nullptr;
    const char* kind() const override { return "Device"; }
    std::string name() const override;
};

struct Device : Module {
    Camera* camera = nullptr;
    uint32_t generation = 0;
    bool readonly = false;
    RemotePort remote;
    std::unique_ptr<Stream> stream;
    // the sensor
    bool acquiring = false;
    uint64_t frame_id = 0, frames_to_expose = 0;
    uint64_t pulses_seen = 0;
    nanoseconds trigger_at = no_time;     // a trigger that waits for its delay
    nanoseconds exposure_end = no_time;   // set while exposing
    nanoseconds exposure_begin = no_time;  // of the last frame
    nanoseconds readable_from{0};         // the sensor takes no new exposure before

    const char* kind() const override { return "TLDevice"; }
    std::string name() const override { return camera->id(); }
    region::Device& block() const { return *camera->block; }
    region::Registers& registers() const { return camera->block->registers; }
    bool lost() const { return camera->unplugged() || generation != camera->block->plug_generation; }
};

std::string RemotePort::name() const { return device->camera->id(); }

struct Buffer : Module {
    enum State { idle, queued, filling, done };
    uint8_t* memory = nullptr;
    std::unique_ptr<uint8_t[]> own;
    size_t size = 0, filled = 0;
    void* user = nullptr;
    State state = idle;
    bool incomplete = false, too_small = false, fresh = false;
    uint32_t width = 0, height = 0, x = 0, y = 0, format = 0, padding = 0, delivered_height = 0;
    uint64_t frame_id = 0, timestamp_ns = 0;
    const char* kind() const override { return "TLBuffer"; }
    std::string name() const override { return "buffer"; }
};

struct Event : Module {
    Stream* stream = nullptr;
    uint64_t fired = 0;
    uint32_t waiting = 0;
    bool killed = false, closing = false;
    const char* kind() const override { return "event"; }
    std::string name() const override { return "new buffer"; }
};

struct Delivery {
    nanoseconds due;
    Buffer* buffer;
};

struct Stream : Module {
    Device* device = nullptr;
    std::vector<std::unique_ptr<Buffer>> buffers;
    std::deque<Buffer*> input, output;
    std::deque<Delivery> on_the_way;
    std::unique_ptr<Event> event;
    std::thread worker;
    std::condition_variable work, arrived;
    bool running = false, stopping = false;
    uint64_t delivered = 0, underrun = 0, started = 0, left_to_acquire = 0;
    pixels::Tone tone;
    pixels::Pattern pattern;
    const char* kind() const override { return "TLDataStream"; }
    std::string name() const override { return device->camera->id() + "-stream"; }
};

struct State {
    std::mutex mutex;
    bool initialised = false;
    Rig rig;
    std::deque<Camera> cameras;
    std::unique_ptr<System> system;
    std::unique_ptr<Interface> link;
    std::unordered_map<Handle, Module*> live;  // every handle given out and not taken back
};

State& state() {
    static State& kept = *new State;  // never destroyed: threads may outlive main()
    return kept;
}

template <class T>
T& find(Handle handle, const char* what) {
    const auto found = state().live.find(handle);
    T* module = found == state().live.end() ? nullptr : dynamic_cast<T*>(found->second);
    if (!module) fail(gentl::invalid_handle, std::string("this is no handle of an open ") + what);
    return *module;
}

Handle give_out(Module& module) {
    state().live[&module] = &module;
    return &module;
}

void take_back(Module& module) { state().live.erase(&module); }

// ---- registers ------------------------------------------------------------------------------------------------------

namespace address {
enum : uint64_t {
    readout = 0x200,
    commands = 0x300,
    acquisition_start = 0x300,
    acquisition_stop = 0x304,
    trigger_software = 0x308,
    timestamp_latch = 0x30C,
    user_set_load = 0x310,
    user_set_save = 0x314,
    device_reset = 0x318,
    user_set_default = 0x31C,
    end = 0x320,
};
}

struct Readout {  // what the camera says of itself, made at each reading
    uint32_t sensor_width, sensor_height, payload_size, spare;  // 0x200
    double temperature_c, frame_rate_hz;                        // 0x210
    char spare_1[32];
    char vendor[32], model[32], serial[32], version[32];  // 0x240
    char spare_2[64];
};
static_assert(sizeof(Readout) == 0x100 && offsetof(Readout, vendor) == 0x40, "device.xml holds these addresses");

region::Registers factory_settings(const region::Device& block) {
    region::Registers r{};
    r.width = block.sensor_width, r.height = block.sensor_height;
    r.pixel_format = pixels::mono8;
    r.acquisition_frame_count = 1;
    r.frame_rate_hz = 15;
    r.exposure_us = 10000;
    r.packet_size = 1500;
    std::memcpy(r.user_id, block.user_id, sizeof r.user_id);
    return r;
}

void load_user_set(region::Device& block, uint32_t set) {
    region::Registers fresh = factory_settings(block);
    if (set == 1 && block.user_set_saved) fresh = block.user_set_1;
    if (block.powered) std::memcpy(fresh.user_id, block.registers.user_id, sizeof fresh.user_id);
    fresh.user_set_selector = set;
    block.registers = fresh;
}

void power_up(region::Device& block) {  // after plugging in, the first access finds the start-up settings
    if (block.powered) return;
    load_user_set(block, block.user_set_default);
    block.powered = 1;
}

size_t payload_size(const Device& device) {
    const region::Registers& r = device.registers();
    return (pixels::row_bytes(r.pixel_format, r.width) + device.block().padding_bytes) * r.height;
}

double transfer_s(const Device& device) {
    const region::Device& block = device.block();
    const double bytes = double(payload_size(device));
    const double packets = std::ceil(bytes / std::max(device.registers().packet_size, 1u));
    const double link = block.link_bytes_per_s > 0 ? bytes / block.link_bytes_per_s : 0;
    return link + packets * device.registers().packet_delay_ns * 1e-9;
}

double shortest_period(const Device& device) {
    const region::Registers& r = device.registers();
    return std::max({r.height * line_s, r.exposure_us * 1e-6, transfer_s(device)});
}

double free_run_period(const Device& device) {
    const region::Registers& r = device.registers();
    return std::max(shortest_period(device), r.frame_rate_enable ? 1 / r.frame_rate_hz : 0.0);
}

Readout read_out(const Device& device) {
    const region::Device& block = device.block();
    Readout out{};
    out.sensor_width = block.sensor_width, out.sensor_height = block.sensor_height;
    out.payload_size = uint32_t(payload_size(device));
    out.temperature_c = block.temperature_c + (device.registers().temperature_selector == 1 ? 4.0 : 0.0);
    out.frame_rate_hz = 1 / free_run_period(device);
    copy_name(out.vendor, sizeof out.vendor, vendor);
    std::memcpy(out.model, block.model, sizeof out.model);
    std::memcpy(out.serial, block.serial, sizeof out.serial);
    copy_name(out.version, sizeof out.version, version);
    return out;
}

void check_settings(const region::Registers& r, const region::Device& block) {
    const auto within = [](double v, double low, double high) { return v >= low && v <= high; };  // false for NaN
    const bool window = r.width >= 64 && r.height >= 64 && r.width % 4 == 0 && r.height % 2 == 0 &&
                        r.offset_x % 4 == 0 && r.offset_y % 2 == 0 &&
                        uint64_t(r.offset_x) + r.width <= block.sensor_width &&
                        uint64_t(r.offset_y) + r.height <= block.sensor_height;
    const bool choices = pixels::known(r.pixel_format) && r.acquisition_mode <= 2 && r.frame_rate_enable <= 1 &&
                         r.trigger_selector == 0 && r.trigger_mode <= 1 && r.trigger_source <= 2 &&
                         r.trigger_activation == 0 && r.exposure_mode == 0 && r.exposure_auto == 0 &&
                         r.gain_auto == 0 && r.temperature_selector <= 1 && r.user_set_selector <= 1;
    const bool ranges = within(r.frame_rate_hz, 0.1, 1000) && within(r.exposure_us, 10, 1e7) &&
                        within(r.gain_db, 0, 24) && within(r.trigger_delay_us, 0, 1e6) &&
                        within(r.acquisition_frame_count, 1, 65535) && within(r.packet_size, 576, 16000) &&
                        r.packet_size % 4 == 0 && within(r.packet_delay_ns, 0, 1e6);
    if (!window || !choices || !ranges) fail(gentl::invalid_value, "the camera does not take this value");
}

void receive_trigger(Device& device, nanoseconds at) {
    region::Device& block = device.block();
    ++block.triggers;
    if (take(block.dropped_trigger_count)) {
        ++block.triggers_dropped;
        return;
    }
    const nanoseconds begin = at + microseconds(int64_t(device.registers().trigger_delay_us));
    if (device.trigger_at != no_time || device.exposure_end != no_time || begin < device.readable_from) {
        ++block.triggers_missed;
        return;
    }
    device.trigger_at = begin;
}

bool triggered_by(const Device& device, uint32_t source) {
    return device.acquiring && device.registers().trigger_mode == 1 && device.registers().trigger_source == source;
}

uint64_t pulses() { return state().rig.header ? state().rig.header->line_pulses.load() : 0; }

void start_sensor(Device& device) {
    const region::Registers& r = device.registers();
    device.acquiring = true;
    device.frame_id = 0;
    const uint64_t frames[] = {gentl::infinite, 1, r.acquisition_frame_count};  // continuous, single, multi
    device.frames_to_expose = frames[r.acquisition_mode];
    device.trigger_at = device.exposure_end = device.exposure_begin = no_time;
    device.readable_from = nanoseconds(0);
    device.pulses_seen = pulses();
    device.block().acquiring = 1;
}

void stop_sensor(Device& device) {
    device.acquiring = false;
    device.trigger_at = device.exposure_end = no_time;
    device.block().acquiring = 0;
}

void reset_device(Device& device) {  // as pulling the plug for a second
    region::Device& block = device.block();
    block.unplugged_until_ns = uint64_t((now() + milliseconds(1000)).count());
    ++block.plug_generation;
    block.powered = 0;
}

void run_command(Device& device, uint64_t at, uint32_t value) {
    region::Device& block = device.block();
    region::Registers& r = device.registers();
    switch (at) {
        case address::acquisition_start: start_sensor(device); break;
        case address::acquisition_stop: stop_sensor(device); break;
        case address::trigger_software:
            if (triggered_by(device, 0))
                receive_trigger(device, now());
            else
                ++block.triggers_missed;
            break;
        case address::timestamp_latch: r.timestamp_latch = now().count() + block.clock_offset_ns; break;
        case address::user_set_load: load_user_set(block, r.user_set_selector); break;
        case address::user_set_save:
            if (r.user_set_selector == 0) fail(gentl::access_denied, "the factory settings cannot be overwritten");
            block.user_set_1 = r;
            block.user_set_saved = 1;
            break;
        case address::device_reset: reset_device(device); break;
        case address::user_set_default:
            if (value > 1) fail(gentl::invalid_value, "there is no such user set");
            block.user_set_default = value;
            break;
        default: fail(gentl::invalid_address, "there is no register at this address");
    }
    if (device.stream) device.stream->work.notify_all();
}

void write_registers(Device& device, uint64_t at, const void* data, size_t size) {
    if (device.readonly) fail(gentl::access_denied, "the camera was opened for reading only");
    if (at >= address::commands && size == 4) {
        uint32_t value;
        std::memcpy(&value, data, sizeof value);
        return run_command(device, at, value);
    }
    region::Registers wanted = device.registers();
    if (at + size > sizeof wanted) fail(gentl::invalid_address, "there is no register to write at this address");
    std::memcpy(reinterpret_cast<uint8_t*>(&wanted) + at, data, size);
    check_settings(wanted, device.block());
    const bool format = at < offsetof(region::Registers, acquisition_frame_count);
    if (device.acquiring && format) fail(gentl::access_denied, "the image format is fixed while the camera streams");
    device.registers() = wanted;
    if (device.stream) device.stream->work.notify_all();
}

void read_registers(const Device& device, uint64_t at, void* out, size_t size) {
    uint8_t all[address::end] = {};
    const Readout readout = read_out(device);
    std::memcpy(all, &device.registers(), sizeof(region::Registers));
    std::memcpy(all + address::readout, &readout, sizeof readout);
    std::memcpy(all + address::user_set_default, &device.block().user_set_default, 4);
    if (at + size > sizeof all) fail(gentl::invalid_address, "there is no register at this address");
    std::memcpy(out, all + at, size);
}

void faulty_port(Device& device, uint64_t at, size_t size, bool writing) {
    region::Device& b = device.block();
    if (device.lost()) fail(gentl::io_error, "the camera does not answer");
    crash_if_asked(b);
    ++(writing ? b.writes : b.reads);
    const uint32_t where = writing ? b.write_error_address : b.read_error_address;
    if (where != region::any_address && (where < at || where >= at + size)) return;
    if (take(writing ? b.write_error_count : b.read_error_count))
        fail(writing ? b.write_error : b.read_error, "a register error that was asked for");
}

// The description every other module owes: its name.
std::string module_xml(const Module& module) {
    const std::string kind = module.kind();
    return "<?xml version=\"1.0\" encoding=\"utf-8\"?><RegisterDescription ModelName=\"" + kind +
           "\" VendorName=\"SphereCal\" ToolTip=\"\" StandardNameSpace=\"None\" SchemaMajorVersion=\"1\" "
           "SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" MinorVersion=\"0\" "
           "SubMinorVersion=\"0\" ProductGuid=\"0f4b35a5-3b1c-4f5e-9d4b-6c6f6f3b2a01\" "
           "VersionGuid=\"e6f3f0b6-6f0f-4f9f-8a7e-31b0c8b1a902\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\" "
           "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
           "xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1 "
           "http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd\">"
           "<Category Name=\"Root\"><pFeature>ModuleID</pFeature></Category><StringReg Name=\"ModuleID\">"
           "<Address>0</Address><Length>64</Length><AccessMode>RO</AccessMode><pPort>" + kind +
           "</pPort></StringReg><Port Name=\"" + kind + "\"/></RegisterDescription>";
}

std::string xml_of(const Module& module) {
    return dynamic_cast<const RemotePort*>(&module) ? std::string(device_xml) : module_xml(module);
}

std::string url_of(const Module& module) {
    char numbers[40];
    std::snprintf(numbers, sizeof numbers, "%llX;%llX", static_cast<unsigned long long>(xml_address),
                  static_cast<unsigned long long>(xml_of(module).size()));
    const bool camera = dynamic_cast<const RemotePort*>(&module) != nullptr;
    return std::string("local:spherecal_") + (camera ? "camera" : module.kind()) + ".xml;" + numbers;
}

Module& find_port(Handle handle) {
    Module& module = find<Module>(handle, "port");
    if (dynamic_cast<Event*>(&module) || dynamic_cast<Buffer*>(&module))
        fail(gentl::invalid_handle, "events and buffers have no port here");
    return module;
}

void read_text(const std::string& text, uint64_t from, void* out, size_t size) {
    std::memset(out, 0, size);
    if (from < text.size()) std::memcpy(out, text.data() + from, std::min<size_t>(size, text.size() - from));
}

// A slow link: the caller waits, everybody else goes on.
Device* reach_camera(Lock& lock, Handle handle) {
    auto* remote = dynamic_cast<RemotePort*>(&find_port(handle));
    if (!remote) return nullptr;
    if (const uint32_t delay = remote->device->block().port_delay_us) {
        lock.unlock();
        std::this_thread::sleep_for(microseconds(delay));
        lock.lock();
        remote = &find<RemotePort>(handle, "camera");
    }
    power_up(remote->device->block());
    return remote->device;
}

void read_port(Lock& lock, Handle handle, uint64_t at, void* out, size_t size) {
    if (!out) fail(gentl::invalid_parameter, "there is no place for the answer");
    Device* device = reach_camera(lock, handle);
    const Module& module = find_port(handle);
    if (at >= xml_address) {
        if (device && device->lost()) fail(gentl::io_error, "the camera does not answer");
        return read_text(xml_of(module), at - xml_address, out, size);
    }
    if (!device) return read_text(module.name(), at, out, size);
    faulty_port(*device, at, size, false);
    read_registers(*device, at, out, size);
}

void write_port(Lock& lock, Handle handle, uint64_t at, const void* data, size_t size) {
    if (!data) fail(gentl::invalid_parameter, "there is nothing to write");
    Device* device = reach_camera(lock, handle);
    if (!device) fail(gentl::access_denied, "this module has nothing to write");
    faulty_port(*device, at, size, true);
    write_registers(*device, at, data, size);
}

// ---- exposing and delivering ----------------------------------------------------------------------------------------

struct Shot {  // everything a frame needs, so that the lock is free while its pixels are written
    Camera* camera;
    uint32_t width, height, x, y, format, padding, rows;
    uint64_t frame_id;
    double factor;
};

Shot aim(const Device& device) {
    const region::Registers& r = device.registers();
    const region::Device& b = device.block();
    double factor = 1;
    if (b.exposure_reference_us > 0)
        factor = r.exposure_us / b.exposure_reference_us * std::pow(10.0, r.gain_db / 20);
    return {device.camera, r.width, r.height, r.offset_x, r.offset_y, r.pixel_format, b.padding_bytes,
            r.height, device.frame_id, factor};
}

template <class Grey>
void write_rows(Stream& stream, const Shot& shot, const Grey* sensor, uint8_t* out) {
    const size_t stride = pixels::row_bytes(shot.format, shot.width) + shot.padding;
    const uint32_t sensor_width = shot.camera->block->sensor_width;
    for (uint32_t row = 0; row < shot.rows; ++row, out += stride) {
        stream.tone.write_row(sensor + size_t(shot.y + row) * sensor_width + shot.x, shot.width, out);
        std::memset(out + stride - shot.padding, 0, shot.padding);
    }
}

void write_pattern(Stream& stream, const Shot& shot, uint8_t* out) {
    const size_t stride = pixels::row_bytes(shot.format, shot.width) + shot.padding;
    stream.tone.prepare(8, shot.format, shot.factor);
    for (uint32_t row = 0; row < shot.rows; ++row, out += stride) {
        stream.tone.write_row(stream.pattern.row(row, shot.width, shot.frame_id), shot.width, out);
        std::memset(out + stride - shot.padding, 0, shot.padding);
    }
}

// Writes the image shown, or the pattern. One that was replaced meanwhile is taken anew; false where that never ends.
bool write_pixels(Stream& stream, const Shot& shot, uint8_t* out) {
    region::Device& block = *shot.camera->block;
    for (int attempt = 0; attempt < 50; ++attempt) {
        const uint64_t image = block.image_published.load(std::memory_order_acquire);
        block.last_image = image;
        if (image == 0) {
            write_pattern(stream, shot, out);
            return true;
        }
        const uint8_t* slot = state().rig.slot(shot.camera->index, image);
        stream.tone.prepare(block.source_bits, shot.format, shot.factor);
        if (block.source_bits == 8)
            write_rows(stream, shot, slot, out);
        else
            write_rows(stream, shot, reinterpret_cast<const uint16_t*>(slot), out);
        std::atomic_thread_fence(std::memory_order_acquire);
        if (block.image_begun.load() < image + 2) return true;
    }
    return false;
}

void describe(Buffer& buffer, const Shot& shot, uint64_t timestamp_ns) {
    buffer.width = shot.width, buffer.height = shot.height, buffer.x = shot.x, buffer.y = shot.y;
    buffer.format = shot.format, buffer.padding = shot.padding;
    buffer.frame_id = shot.frame_id, buffer.timestamp_ns = timestamp_ns;
    buffer.delivered_height = shot.rows;
    buffer.filled = (pixels::row_bytes(shot.format, shot.width) + shot.padding) * shot.rows;
    buffer.incomplete = buffer.too_small || shot.rows < shot.height;
    buffer.fresh = true;
}

Buffer* next_buffer(Stream& stream) {
    region::Device& block = stream.device->block();
    if (take(block.lost_frame_count)) {
        ++block.frames_lost;
        return nullptr;
    }
    if (stream.input.empty() || stream.left_to_acquire == 0) {
        ++stream.underrun;
        ++block.frames_underrun;
        return nullptr;
    }
    if (stream.left_to_acquire != gentl::infinite) --stream.left_to_acquire;
    Buffer* buffer = stream.input.front();
    stream.input.pop_front();
    buffer->state = Buffer::filling;
    return buffer;
}

void finish_exposure(Lock& lock, Stream& stream) {
    Device& device = *stream.device;
    region::Device& block = device.block();
    const nanoseconds begin = device.exposure_begin;
    device.exposure_end = no_time;
    ++device.frame_id;
    ++block.frames_exposed;
    if (device.frames_to_expose != gentl::infinite && --device.frames_to_expose == 0) stop_sensor(device);
    Buffer* buffer = next_buffer(stream);
    if (!buffer) return;
    ++stream.started;
    Shot shot = aim(device);
    const size_t row = pixels::row_bytes(shot.format, shot.width) + shot.padding;
    const uint32_t fits = uint32_t(std::min<size_t>(buffer->size / row, shot.height));
    buffer->too_small = fits < shot.height;
    shot.rows = take(block.incomplete_count) ? fits / 2 : fits;
    const bool late = take(block.late_count);
    nanoseconds due = now() + seconds(transfer_s(device)) + (late ? milliseconds(block.late_ms) : milliseconds(0));
    block.frames_late += late;
    lock.unlock();
    const bool whole = write_pixels(stream, shot, buffer->memory);
    lock.lock();
    describe(*buffer, shot, uint64_t(begin.count() + block.clock_offset_ns));
    buffer->incomplete |= !whole;
    if (!stream.on_the_way.empty()) due = std::max(due, stream.on_the_way.back().due);  // a link keeps the order
    stream.on_the_way.push_back({due, buffer});
}

void deliver_due(Stream& stream) {
    region::Device& block = stream.device->block();
    while (!stream.on_the_way.empty() && stream.on_the_way.front().due <= now()) {
        Buffer* buffer = stream.on_the_way.front().buffer;
        stream.on_the_way.pop_front();
        buffer->state = Buffer::done;
        stream.output.push_back(buffer);
        ++stream.delivered;
        ++block.frames_delivered;
        block.frames_incomplete += buffer->incomplete;
        if (stream.event) ++stream.event->fired;
        stream.arrived.notify_all();
    }
}

void drop_on_the_way(Stream& stream) {
    for (const Delivery& delivery : stream.on_the_way) {
        delivery.buffer->state = Buffer::queued;
        stream.input.push_back(delivery.buffer);
    }
    stream.on_the_way.clear();
}

void watch_line(Device& device) {
    const uint64_t seen = pulses();
    if (seen == device.pulses_seen) return;
    device.pulses_seen = seen;
    if (!triggered_by(device, 1)) return;
    const nanoseconds pulse{int64_t(state().rig.header->line_pulse_ns.load())};
    const bool recent = pulse <= now() && now() - pulse < milliseconds(100);
    receive_trigger(device, recent ? pulse : now());
}

// When the next exposure begins, as far as it is known.
nanoseconds next_begin(Device& device) {
    if (device.registers().trigger_mode == 1) return device.trigger_at;
    if (device.exposure_begin == no_time) return now();
    const nanoseconds period = seconds(free_run_period(device)), next = device.exposure_begin + period;
    return now() - next > period ? now() : next;  // what was slept through is not made up for
}

void begin_exposure(Device& device, nanoseconds begin) {
    device.trigger_at = no_time;
    device.exposure_begin = begin;
    device.exposure_end = begin + microseconds(int64_t(device.registers().exposure_us));
    device.readable_from = begin + seconds(shortest_period(device));
}

// One step of a stream's thread; returns when to look again.
nanoseconds step(Lock& lock, Stream& stream) {
    Device& device = *stream.device;
    if (device.lost()) {
        drop_on_the_way(stream);
        stop_sensor(device);
        return now() + milliseconds(20);
    }
    deliver_due(stream);
    const nanoseconds due = stream.on_the_way.empty() ? no_time : stream.on_the_way.front().due;
    if (!device.acquiring) return std::min(due, now() + milliseconds(50));
    watch_line(device);
    if (device.exposure_end != no_time) {
        if (now() < device.exposure_end) return std::min(due, device.exposure_end);
        finish_exposure(lock, stream);
        return now();
    }
    const nanoseconds begin = next_begin(device);
    if (begin <= now()) {
        begin_exposure(device, begin);
        return now();
    }
    const bool on_line = triggered_by(device, 1);
    return std::min({due, begin, now() + (on_line ? milliseconds(1) : milliseconds(50))});
}

// What these threads do is done by sensors and links in a real rig, so they give way to the program that is tested:
// twelve of them at once made a 16 ms timer of that program 9.5 ms late (95th percentile; two cores, otherwise idle).
// SPHERECAL_GENTL_IDLE=1: to everything, for measurements on a machine with nothing else to do.
void give_way() {
#if defined(__linux__)
    const char* idle = std::getenv("SPHERECAL_GENTL_IDLE");
    const sched_param none{};
    const auto thread = id_t(syscall(SYS_gettid));
    if (idle && *idle == '1')
        pthread_setschedparam(pthread_self(), SCHED_IDLE, &none);
    else
        setpriority(PRIO_PROCESS, thread, getpriority(PRIO_PROCESS, thread) + 5);
#elif defined(_WIN32)
    SetThreadPriority(GetCurrentThread(), THREAD_PRIORITY_BELOW_NORMAL);
#endif
}

void run(Stream& stream) {
    give_way();
    Lock lock(state().mutex);
    while (!stream.stopping) {
        const nanoseconds again = step(lock, stream);
        if (again > now() && !stream.stopping) stream.work.wait_until(lock, Clock::time_point(again));
    }
}

void stop_stream(Lock& lock, Stream& stream) {
    if (!stream.running) return;
    stream.stopping = true;
    stream.work.notify_all();
    lock.unlock();
    stream.worker.join();
    lock.lock();
    drop_on_the_way(stream);
    stream.running = stream.stopping = false;
    ++stream.device->block().acquisition_stops;
}

void close_event(Lock& lock, Stream& stream) {
    if (!stream.event) return;
    stream.event->closing = true;
    stream.arrived.notify_all();
    while (stream.event->waiting > 0) stream.work.wait_for(lock, milliseconds(1));
    take_back(*stream.event);
    stream.event.reset();
}

void close_stream(Lock& lock, Device& device) {
    if (!device.stream) return;
    Stream& stream = *device.stream;
    stop_stream(lock, stream);
    close_event(lock, stream);
    for (const auto& buffer : stream.buffers) take_back(*buffer);
    take_back(stream);
    device.stream.reset();
}

void close_device(Lock& lock, Device& device) {
    close_stream(lock, device);
    region::Device& block = device.block();
    if (!device.lost()) stop_sensor(device);
    ++block.closed;
    block.open_by_pid = 0;
    device.camera->opened = nullptr;
    take_back(device.remote);
    take_back(device);
    delete &device;
}

void close_all(Lock& lock) {
    for (Camera& camera : state().cameras)
        if (camera.opened) close_device(lock, *camera.opened);
    state().link.reset();
    state().system.reset();
    state().live.clear();
    state().cameras.clear();
}

// ---- small helpers of the exported functions ------------------------------------------------------------------------

template <class Body>
Error guarded(Body body) {
    try {
        Lock lock(state().mutex);
        if (!state().initialised) fail(gentl::not_initialised, "GCInitLib was not called");
        body(lock);
        return gentl::success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    } catch (const std::bad_alloc&) {
        return remember(gentl::out_of_memory, "out of memory");
    } catch (...) {
        return remember(gentl::failed, "unexpected error");
    }
}

Camera& find_camera(const char* id) {
    const std::string wanted = &required(id);
    for (Camera& camera : state().cameras)
        if (camera.id() == wanted) return camera;
    fail(gentl::invalid_id, "there is no camera " + wanted);
}

Camera& listed_camera(uint32_t index) {
    for (Camera& camera : state().cameras)
        if (camera.listed && index-- == 0) return camera;
    fail(gentl::invalid_index, "there are not that many cameras");
}

int32_t access_status(const Camera& camera) {
    namespace access = gentl::access;
    if (camera.opened && camera.opened->lost()) return access::no_access;
    if (camera.unplugged()) return access::no_access;
    if (camera.opened) return camera.opened->readonly ? access::open_readonly_by_us : access::open_by_us;
    const int32_t refusal = camera.block->open_error;
    if (refusal == 0) return access::can_write;
    return refusal == gentl::access_denied || refusal == gentl::resource_in_use ? access::is_busy : access::no_access;
}

void about_device(const Camera& camera, int32_t what, const Answer& answer) {
    namespace info = gentl::device_info;
    power_up(*camera.block);
    switch (what) {
        case info::id: return answer.text(camera.id());
        case info::vendor: return answer.text(vendor);
        case info::model: return answer.text(camera.model());
        case info::type: return answer.text(transport);
        case info::display_name:
            return answer.text(std::string(vendor) + " " + camera.model() + " (" + camera.serial() + ")");
        case info::access: return answer.i32(access_status(camera));
        case info::user_name: {
            const char* name = camera.block->registers.user_id;
            return answer.text(std::string(name, strnlen(name, sizeof camera.block->registers.user_id)));
        }
        case info::serial: return answer.text(camera.serial());
        case info::version: return answer.text(version);
        case info::timestamp_frequency: return answer.u64(1000000000);
        default: fail(gentl::not_implemented, "not known of a camera");
    }
}

void about_interface(int32_t what, const Answer& answer) {
    namespace info = gentl::interface_info;
    switch (what) {
        case info::id: return answer.text(interface_name);
        case info::display_name: return answer.text("SphereCal simulated link");
        case info::type: return answer.text(transport);
        default: fail(gentl::not_implemented, "not known of an interface");
    }
}

std::string own_path() {
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

void about_producer(int32_t what, const Answer& answer) {
    namespace info = gentl::tl_info;
    const std::string path = own_path();
    switch (what) {
        case info::id: return answer.text(producer_id);
        case info::vendor: return answer.text(vendor);
        case info::model: return answer.text("Simulated GenTL producer");
        case info::version: return answer.text(version);
        case info::type: return answer.text(transport);
        case info::name: return answer.text(path.substr(path.find_last_of("/\\") + 1));
        case info::path: return answer.text(path);
        case info::display_name: return answer.text("SphereCal simulated cameras");
        case info::encoding: return answer.i32(1);
        case info::version_major: return answer.u32(1);
        case info::version_minor: return answer.u32(5);
        default: fail(gentl::not_implemented, "not known of a producer");
    }
}

void about_stream(const Stream& stream, int32_t what, const Answer& answer) {
    namespace info = gentl::stream_info;
    switch (what) {
        case info::id: return answer.text(stream.name());
        case info::delivered: return answer.u64(stream.delivered);
        case info::underrun: return answer.u64(stream.underrun);
        case info::announced: return answer.count(stream.buffers.size());
        case info::queued: return answer.count(stream.input.size());
        case info::awaiting_delivery: return answer.count(stream.output.size());
        case info::started: return answer.u64(stream.started);
        case info::payload_size: return answer.count(payload_size(*stream.device));
        case info::grabbing: return answer.flag(stream.running);
        case info::defines_payload_size: return answer.flag(true);
        case info::type: return answer.text(transport);
        case info::most_chunks: return answer.count(0);
        case info::least_buffers: return answer.count(1);
        case info::alignment: return answer.count(1);
        default: fail(gentl::not_implemented, "not known of a stream");
    }
}

void about_image(const Buffer& buffer, int32_t what, const Answer& answer) {
    namespace info = gentl::buffer_info;
    if (buffer.frame_id == 0) fail(gentl::no_data, "this buffer has never been filled");
    switch (what) {
        case info::width: return answer.count(buffer.width);
        case info::height: return answer.count(buffer.height);
        case info::x_offset: return answer.count(buffer.x);
        case info::y_offset: return answer.count(buffer.y);
        case info::x_padding: return answer.count(buffer.padding);
        case info::y_padding: return answer.count(0);
        case info::frame_id: return answer.u64(buffer.frame_id);
        case info::has_image: return answer.flag(true);
        case info::image_offset: return answer.count(0);
        case info::payload_type: return answer.count(gentl::payload_is_image);
        case info::pixel_format: return answer.u64(buffer.format);
        case info::pixel_format_namespace: return answer.u64(gentl::namespace_pfnc32);
        case info::delivered_height: return answer.count(buffer.delivered_height);
        case info::endianness: return answer.i32(gentl::little_endian);
        case info::timestamp:
        case info::timestamp_ns: return answer.u64(buffer.timestamp_ns);
        default: fail(gentl::not_available, "not known of an image");
    }
}

void about_buffer(Buffer& buffer, int32_t what, const Answer& answer) {
    namespace info = gentl::buffer_info;
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
        case info::type: return answer.text(transport);
        case info::size_filled:
        case info::data_size: return answer.count(buffer.filled);
        case info::larger_than_buffer: return answer.flag(buffer.too_small);
        case info::has_chunks:
        case info::is_composite: return answer.flag(false);
        default: about_image(buffer, what, answer);
    }
}

void about_port(const Module& module, int32_t what, const Answer& answer) {
    namespace info = gentl::port_info;
    const auto* remote = dynamic_cast<const RemotePort*>(&module);
    switch (what) {
        case info::id: return answer.text(module.name());
        case info::vendor: return answer.text(vendor);
        case info::model: return answer.text(remote ? remote->device->camera->model() : module.kind());
        case info::type: return answer.text(transport);
        case info::module: return answer.text(module.kind());
        case info::name: return answer.text(remote ? "Device" : module.kind());
        case info::little_endian:
        case info::can_read: return answer.flag(true);
        case info::can_write: return answer.flag(remote && !remote->device->readonly);
        case info::big_endian:
        case info::not_accessible:
        case info::not_implemented: return answer.flag(false);
        case info::version: return answer.text(version);
        default: fail(gentl::not_implemented, "not known of a port");
    }
}

void about_url(const Module& module, int32_t what, const Answer& answer) {
    namespace info = gentl::url_info;
    switch (what) {
        case info::url: return answer.text(url_of(module));
        case info::schema_major:
        case info::schema_minor:
        case info::file_major: return answer.i32(1);
        case info::file_minor:
        case info::file_subminor: return answer.i32(0);
        case info::address: return answer.u64(xml_address);
        case info::size: return answer.u64(xml_of(module).size());
        case info::scheme: return answer.i32(0);  // in the port's own registers
        default: fail(gentl::not_available, "not known of a description");
    }
}

Handle announce(Stream& stream, std::unique_ptr<Buffer> buffer) {
    stream.buffers.push_back(std::move(buffer));
    return give_out(*stream.buffers.back());
}

Buffer& find_buffer(Stream& stream, Handle handle) {
    for (const auto& buffer : stream.buffers)
        if (buffer.get() == handle) return *buffer;
    fail(gentl::invalid_buffer, "this buffer is not announced to this stream");
}

void queue_buffer(Stream& stream, Buffer& buffer) {
    if (buffer.state != Buffer::idle) fail(gentl::resource_in_use, "this buffer is queued already");
    buffer.state = Buffer::queued;
    buffer.filled = 0;
    stream.input.push_back(&buffer);
}

void release(std::deque<Buffer*>& queue) {
    for (Buffer* buffer : queue) buffer->state = Buffer::idle;
    queue.clear();
}

void flush(Stream& stream, int32_t how) {
    switch (how) {
        case gentl::flush::input_to_output:
            for (Buffer* buffer : stream.input) {
                buffer->state = Buffer::done;
                stream.output.push_back(buffer);
            }
            stream.input.clear();
            stream.arrived.notify_all();
            return;
        case gentl::flush::discard_output: return release(stream.output);
        case gentl::flush::all_to_input:
            release(stream.output);
            [[fallthrough]];
        case gentl::flush::unqueued_to_input:
            for (const auto& buffer : stream.buffers)
                if (buffer->state == Buffer::idle) queue_buffer(stream, *buffer);
            return;
        case gentl::flush::discard_all:
            release(stream.input);
            return release(stream.output);
        default: fail(gentl::invalid_parameter, "there is no such way to flush");
    }
}

void await_buffer(Lock& lock, Event& event, uint64_t timeout_ms) {
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
        fail(gentl::aborted, "waiting was ended");
    }
    if (stream.output.empty()) fail(gentl::timeout, "no buffer has arrived in time");
}

}  // namespace

// ---- the library ----------------------------------------------------------------------------------------------------

#define INFO_ARGUMENTS int32_t what, int32_t *type, void *out, size_t *size
#define ANSWER Answer{type, out, size}

GENTL_EXPORT Error GCInitLib() {
    try {
        Lock lock(state().mutex);
        if (state().initialised) fail(gentl::resource_in_use, "the producer is initialised already");
        state().initialised = true;
        return gentl::success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    }
}

GENTL_EXPORT Error GCCloseLib() {
    return guarded([&](Lock& lock) {
        close_all(lock);
        state().rig.close();
        state().initialised = false;
    });
}

GENTL_EXPORT Error GCGetInfo(INFO_ARGUMENTS) {  // allowed before GCInitLib
    try {
        about_producer(what, ANSWER);
        return gentl::success;
    } catch (const Failure& failure) {
        return remember(failure.code, failure.text);
    }
}

GENTL_EXPORT Error GCGetLastError(Error* code, char* text, size_t* size) {
    const Failure last = last_failure;
    try {
        required(code) = last.code;
        answer_text(text, size, last.text);
        return gentl::success;
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

GENTL_EXPORT Error GCReadPortStacked(Handle port, gentl::PortEntry* entries, size_t* count) {
    return guarded([&](Lock& lock) {
        const size_t wanted = required(count);
        for (*count = 0; *count < wanted; ++*count)
            read_port(lock, port, entries[*count].address, entries[*count].buffer, entries[*count].size);
    });
}

GENTL_EXPORT Error GCWritePortStacked(Handle port, gentl::PortEntry* entries, size_t* count) {
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
        if (index != 0) fail(gentl::invalid_index, "a port has one description");
        about_url(find_port(port), what, ANSWER);
    });
}

GENTL_EXPORT Error GCGetPortInfo(Handle port, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_port(find_port(port), what, ANSWER); });
}

// ---- events ---------------------------------------------------------------------------------------------------------

GENTL_EXPORT Error GCRegisterEvent(Handle source, int32_t kind, Handle* out) {
    return guarded([&](Lock&) {
        auto* stream = dynamic_cast<Stream*>(&find<Module>(source, "module"));
        if (!stream || kind != gentl::event_new_buffer) fail(gentl::not_implemented, "this event does not happen here");
        if (stream->event) fail(gentl::resource_in_use, "the event is registered already");
        stream->event = std::make_unique<Event>();
        stream->event->stream = stream;
        required(out) = give_out(*stream->event);
    });
}

GENTL_EXPORT Error GCUnregisterEvent(Handle source, int32_t kind) {
    return guarded([&](Lock& lock) {
        auto* stream = dynamic_cast<Stream*>(&find<Module>(source, "module"));
        if (!stream || kind != gentl::event_new_buffer || !stream->event)
            fail(gentl::invalid_parameter, "the event is not registered");
        close_event(lock, *stream);
    });
}

GENTL_EXPORT Error EventGetData(Handle handle, void* out, size_t* size, uint64_t timeout_ms) {
    return guarded([&](Lock& lock) {
        Event& event = find<Event>(handle, "event");
        Stream& stream = *event.stream;
        region::Device& block = stream.device->block();
        crash_if_asked(block);
        if (take(block.event_error_count)) fail(block.event_error, "an error of the stream that was asked for");
        const Answer answer{nullptr, out, size};
        if (out && required(size) < sizeof(gentl::NewBuffer)) fail(gentl::buffer_too_small, "the event needs 16 bytes");
        await_buffer(lock, event, timeout_ms);
        Buffer& buffer = *stream.output.front();
        const gentl::NewBuffer data{&buffer, buffer.user};
        answer.bytes(0, &data, sizeof data);
        if (!out) return;
        stream.output.pop_front();
        buffer.state = Buffer::idle;  // now the client's
    });
}

GENTL_EXPORT Error EventGetDataInfo(Handle handle, const void* in, size_t in_size, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        find<Event>(handle, "event");
        if (!in || in_size < sizeof(gentl::NewBuffer)) fail(gentl::invalid_parameter, "this is no event's data");
        gentl::NewBuffer data;
        std::memcpy(&data, in, sizeof data);
        if (what == gentl::event_data::id) return ANSWER.pointer(data.buffer);
        if (what == gentl::event_data::value) return ANSWER.pointer(data.user);
        fail(gentl::not_implemented, "not known of an event's data");
    });
}

GENTL_EXPORT Error EventGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        const Event& event = find<Event>(handle, "event");
        switch (what) {
            case gentl::event_info::type: return ANSWER.i32(gentl::event_new_buffer);
            case gentl::event_info::in_queue: return ANSWER.count(event.stream->output.size());
            case gentl::event_info::fired: return ANSWER.u64(event.fired);
            case gentl::event_info::largest: return ANSWER.count(sizeof(gentl::NewBuffer));
            case gentl::event_info::largest_info: return ANSWER.count(sizeof(void*));
            default: fail(gentl::not_implemented, "not known of an event");
        }
    });
}

GENTL_EXPORT Error EventFlush(Handle handle) {
    return guarded([&](Lock&) { release(find<Event>(handle, "event").stream->output); });
}

GENTL_EXPORT Error EventKill(Handle handle) {
    return guarded([&](Lock&) {
        Event& event = find<Event>(handle, "event");
        event.killed = true;
        event.stream->arrived.notify_all();
    });
}

// ---- system and interface -------------------------------------------------------------------------------------------

GENTL_EXPORT Error TLOpen(Handle* out) {
    return guarded([&](Lock&) {
        if (state().system) fail(gentl::resource_in_use, "the producer is open already");
        state().rig.open();
        for (uint32_t i = 0; i < state().rig.count; ++i) {
            Camera camera;
            camera.index = i;
            camera.block = &state().rig.device(i);
            state().cameras.push_back(camera);
        }
        state().system = std::make_unique<System>();
        required(out) = give_out(*state().system);
    });
}

GENTL_EXPORT Error TLClose(Handle system) {
    return guarded([&](Lock& lock) {
        find<System>(system, "producer");
        close_all(lock);
        state().rig.close();
    });
}

GENTL_EXPORT Error TLGetInfo(Handle system, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { find<System>(system, "producer"), about_producer(what, ANSWER); });
}

GENTL_EXPORT Error TLGetNumInterfaces(Handle system, uint32_t* count) {
    return guarded([&](Lock&) { find<System>(system, "producer"), required(count) = 1; });
}

GENTL_EXPORT Error TLGetInterfaceID(Handle system, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        if (index != 0) fail(gentl::invalid_index, "there is one interface");
        answer_text(id, size, interface_name);
    });
}

GENTL_EXPORT Error TLGetInterfaceInfo(Handle system, const char* id, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        if (std::string(&required(id)) != interface_name) fail(gentl::invalid_id, "there is no such interface");
        about_interface(what, ANSWER);
    });
}

GENTL_EXPORT Error TLOpenInterface(Handle system, const char* id, Handle* out) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        if (std::string(&required(id)) != interface_name) fail(gentl::invalid_id, "there is no such interface");
        if (state().link) fail(gentl::resource_in_use, "the interface is open already");
        state().link = std::make_unique<Interface>();
        required(out) = give_out(*state().link);
    });
}

GENTL_EXPORT Error TLUpdateInterfaceList(Handle system, uint8_t* changed, uint64_t) {
    return guarded([&](Lock&) {
        find<System>(system, "producer");
        if (changed) *changed = 0;
    });
}

GENTL_EXPORT Error IFClose(Handle handle) {
    return guarded([&](Lock& lock) {
        Interface& link = find<Interface>(handle, "interface");
        for (Camera& camera : state().cameras)
            if (camera.opened) close_device(lock, *camera.opened);
        take_back(link);
        state().link.reset();
    });
}

GENTL_EXPORT Error IFGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { find<Interface>(handle, "interface"), about_interface(what, ANSWER); });
}

GENTL_EXPORT Error IFGetParentTL(Handle handle, Handle* out) {
    return guarded([&](Lock&) { find<Interface>(handle, "interface"), required(out) = state().system.get(); });
}

GENTL_EXPORT Error IFUpdateDeviceList(Handle handle, uint8_t* changed, uint64_t) {
    return guarded([&](Lock&) {
        find<Interface>(handle, "interface");
        bool any = false;
        for (Camera& camera : state().cameras) {
            const bool there = !camera.unplugged();
            any |= there != camera.listed;
            camera.listed = there;
        }
        if (changed) *changed = any;
    });
}

GENTL_EXPORT Error IFGetNumDevices(Handle handle, uint32_t* count) {
    return guarded([&](Lock&) {
        find<Interface>(handle, "interface");
        required(count) = 0;
        for (const Camera& camera : state().cameras) *count += camera.listed;
    });
}

GENTL_EXPORT Error IFGetDeviceID(Handle handle, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        find<Interface>(handle, "interface");
        answer_text(id, size, listed_camera(index).id());
    });
}

GENTL_EXPORT Error IFGetDeviceInfo(Handle handle, const char* id, INFO_ARGUMENTS) {
    return guarded([&](Lock&) {
        find<Interface>(handle, "interface");
        about_device(find_camera(id), what, ANSWER);
    });
}

GENTL_EXPORT Error IFOpenDevice(Handle handle, const char* id, int32_t flags, Handle* out) {
    return guarded([&](Lock&) {
        find<Interface>(handle, "interface");
        required(out);
        Camera& camera = find_camera(id);
        if (camera.opened) fail(gentl::resource_in_use, "this program has the camera open already");
        if (camera.unplugged()) fail(gentl::not_available, "the camera does not answer");
        if (camera.block->open_error != 0) fail(camera.block->open_error, "another program has the camera");
        if (flags < gentl::access::readonly || flags > gentl::access::exclusive)
            fail(gentl::invalid_parameter, "there is no such way to open a camera");
        auto device = std::make_unique<Device>();
        device->camera = &camera;
        device->generation = camera.block->plug_generation;
        device->readonly = flags == gentl::access::readonly;
        device->remote.device = device.get();
        give_out(device->remote);
        power_up(*camera.block);
        ++camera.block->opened;
#if defined(_WIN32)
        camera.block->open_by_pid = uint32_t(GetCurrentProcessId());
#else
        camera.block->open_by_pid = uint32_t(getpid());
#endif
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
    return guarded([&](Lock&) { about_device(*find<Device>(handle, "camera").camera, what, ANSWER); });
}

GENTL_EXPORT Error DevGetParentIF(Handle handle, Handle* out) {
    return guarded([&](Lock&) { find<Device>(handle, "camera"), required(out) = state().link.get(); });
}

GENTL_EXPORT Error DevGetNumDataStreams(Handle handle, uint32_t* count) {
    return guarded([&](Lock&) { find<Device>(handle, "camera"), required(count) = 1; });
}

GENTL_EXPORT Error DevGetDataStreamID(Handle handle, uint32_t index, char* id, size_t* size) {
    return guarded([&](Lock&) {
        const Device& device = find<Device>(handle, "camera");
        if (index != 0) fail(gentl::invalid_index, "a camera has one stream");
        answer_text(id, size, device.camera->id() + "-stream");
    });
}

GENTL_EXPORT Error DevOpenDataStream(Handle handle, const char* id, Handle* out) {
    return guarded([&](Lock&) {
        Device& device = find<Device>(handle, "camera");
        if (std::string(&required(id)) != device.camera->id() + "-stream")
            fail(gentl::invalid_id, "there is no such stream");
        if (device.stream) fail(gentl::resource_in_use, "the stream is open already");
        if (device.lost()) fail(gentl::io_error, "the camera does not answer");
        device.stream = std::make_unique<Stream>();
        device.stream->device = &device;
        required(out) = give_out(*device.stream);
    });
}

// ---- data stream ----------------------------------------------------------------------------------------------------

GENTL_EXPORT Error DSClose(Handle handle) {
    return guarded([&](Lock& lock) { close_stream(lock, *find<Stream>(handle, "stream").device); });
}

GENTL_EXPORT Error DSGetInfo(Handle handle, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_stream(find<Stream>(handle, "stream"), what, ANSWER); });
}

GENTL_EXPORT Error DSGetParentDev(Handle handle, Handle* out) {
    return guarded([&](Lock&) { required(out) = find<Stream>(handle, "stream").device; });
}

GENTL_EXPORT Error DSAnnounceBuffer(Handle handle, void* memory, size_t size, void* user, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (!memory || size == 0) fail(gentl::invalid_parameter, "a buffer needs memory");
        auto buffer = std::make_unique<Buffer>();
        buffer->memory = static_cast<uint8_t*>(memory), buffer->size = size, buffer->user = user;
        required(out) = announce(stream, std::move(buffer));
    });
}

GENTL_EXPORT Error DSAllocAndAnnounceBuffer(Handle handle, size_t size, void* user, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (size == 0) fail(gentl::invalid_parameter, "a buffer needs memory");
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
        if (buffer.state != Buffer::idle) fail(gentl::busy, "a queued buffer cannot be revoked");
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
    return guarded([&](Lock&) { flush(find<Stream>(handle, "stream"), how); });
}

GENTL_EXPORT Error DSGetBufferID(Handle handle, uint32_t index, Handle* out) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (index >= stream.buffers.size()) fail(gentl::invalid_index, "there are not that many buffers");
        required(out) = stream.buffers[index].get();
    });
}

GENTL_EXPORT Error DSGetBufferInfo(Handle handle, Handle buffer, INFO_ARGUMENTS) {
    return guarded([&](Lock&) { about_buffer(find_buffer(find<Stream>(handle, "stream"), buffer), what, ANSWER); });
}

GENTL_EXPORT Error DSGetBufferChunkData(Handle handle, Handle buffer, void*, size_t* count) {
    return guarded([&](Lock&) { find_buffer(find<Stream>(handle, "stream"), buffer), required(count) = 0; });
}

GENTL_EXPORT Error DSGetNumBufferParts(Handle handle, Handle buffer, uint32_t* count) {
    return guarded([&](Lock&) { find_buffer(find<Stream>(handle, "stream"), buffer), required(count) = 0; });
}

GENTL_EXPORT Error DSGetBufferPartInfo(Handle, Handle, uint32_t, INFO_ARGUMENTS) {
    (void)what, (void)type, (void)out, (void)size;
    return guarded([](Lock&) { fail(gentl::not_available, "a frame here has one part only"); });
}

GENTL_EXPORT Error DSStartAcquisition(Handle handle, int32_t, uint64_t frames) {
    return guarded([&](Lock&) {
        Stream& stream = find<Stream>(handle, "stream");
        if (stream.running) fail(gentl::resource_in_use, "the stream runs already");
        if (stream.device->lost()) fail(gentl::io_error, "the camera does not answer");
        stream.delivered = stream.underrun = stream.started = 0;
        stream.left_to_acquire = frames;
        stream.running = true;
        ++stream.device->block().acquisition_starts;
        stream.worker = std::thread([&stream] { run(stream); });
    });
}

GENTL_EXPORT Error DSStopAcquisition(Handle handle, int32_t) {
    return guarded([&](Lock& lock) {
        Stream& stream = find<Stream>(handle, "stream");
        if (!stream.running) fail(gentl::resource_in_use, "the stream does not run");
        stop_stream(lock, stream);
    });
}

// ---- GenTL 1.6: consumers complain on their screens where these are missing -----------------------------------------

GENTL_EXPORT Error DSAnnounceCompositeBuffer(Handle, size_t, void**, size_t*, void*, Handle*) {
    return guarded([](Lock&) { fail(gentl::not_implemented, "there are no composite buffers here"); });
}

GENTL_EXPORT Error DSGetNumFlows(Handle, uint32_t*) {
    return guarded([](Lock&) { fail(gentl::not_implemented, "there are no flows here"); });
}

GENTL_EXPORT Error DSGetFlowInfo(Handle, uint32_t, INFO_ARGUMENTS) {
    (void)what, (void)type, (void)out, (void)size;
    return guarded([](Lock&) { fail(gentl::not_implemented, "there are no flows here"); });
}

GENTL_EXPORT Error DSGetNumBufferSegments(Handle, Handle, uint32_t*) {
    return guarded([](Lock&) { fail(gentl::not_implemented, "there are no composite buffers here"); });
}

GENTL_EXPORT Error DSGetBufferSegmentInfo(Handle, Handle, uint32_t, INFO_ARGUMENTS) {
    (void)what, (void)type, (void)out, (void)size;
    return guarded([](Lock&) { fail(gentl::not_implemented, "there are no composite buffers here"); });
}
