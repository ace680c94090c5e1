// A GenTL producer (.cti) of simulated cameras for tests and training: no hardware, the whole real software path.
//
// The cameras live in a shared memory region that control.py makes (region.h); without one there are twelve cameras
// that show a moving pattern. One lock guards everything; each stream has one thread that exposes and delivers frames.
// README.md says what the cameras do, and which faults can be asked of them.

#include <csignal>
#include <cstdlib>
#include <thread>

#if defined(_WIN32)
#define NOMINMAX
#include <windows.h>
#else
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
#include "gentl_exports.h"
#include "odd.h"
#include "pixels.h"
#include "region.h"

namespace {

using gentl::Away;
using gentl::Buffer;
using gentl::Clock;
using gentl::fail;
using gentl::Lock;
using gentl::state;
using gentl::vendor;
using gentl::version;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr const char* producer_id = "spherecal-simulated";
constexpr const char* interface_name = "spherecal-simulated-link";
constexpr const char* transport = "Custom";
constexpr double line_s = 2.44e-6;  // what the sensor's readout takes for a line: 5 ms for 2048
const nanoseconds no_time = nanoseconds::max();

nanoseconds now() { return Clock::now().time_since_epoch(); }
nanoseconds seconds(double s) { return nanoseconds(int64_t(s * 1e9)); }

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

Rig& rig() {
    static Rig& kept = *new Rig;  // never destroyed: threads may outlive main()
    return kept;
}

const bool tailed = (gentl::error_tail = [] { return odd::bytes("texts"); }, true);

int32_t opened_status(const gentl::Device& device);
void power_up(region::Device& block);

struct Camera : gentl::Camera {  // one of the rig
    uint32_t index = 0;
    region::Device* block = nullptr;

    bool unplugged() const { return uint64_t(now().count()) < block->unplugged_until_ns; }
    std::string id() const override { return "SphereCal-" + own_serial(); }
    std::string vendor() const override { return gentl::vendor + odd::bytes("texts"); }
    std::string model() const override {
        return odd::word("model").value_or(std::string(block->model, strnlen(block->model, sizeof block->model)));
    }
    std::string serial() const override { return odd::word("serial").value_or(own_serial()); }
    std::string own_serial() const {
        return std::string(block->serial, strnlen(block->serial, sizeof block->serial));
    }
    std::string user_name() const override {
        const char* name = block->registers.user_id;
        return std::string(name, strnlen(name, sizeof block->registers.user_id));
    }
    std::string version() const override { return gentl::version; }
    std::string type() const override { return transport; }
    int32_t access_status() const override {
        namespace access = gentl::access;
        if (unplugged()) return access::no_access;
        if (opened) return opened_status(*opened);
        const int32_t refusal = block->open_error;
        if (refusal == 0) return access::can_write;
        return refusal == gentl::access_denied || refusal == gentl::resource_in_use ? access::is_busy
                                                                                    : access::no_access;
    }
    void before_asked() override { power_up(*block); }
    std::unique_ptr<gentl::Device> open(Lock&, int32_t how) override;
};

struct Interface : gentl::Interface {
    std::string name() const override { return interface_name; }
    std::string display_name() const override { return "SphereCal simulated link"; }
    std::string type() const override { return transport; }
    bool refresh(Lock&, uint64_t) override {
        bool any = false;
        for (const auto& camera : cameras) {
            const bool there = !static_cast<Camera&>(*camera).unplugged();
            any |= there != camera->listed;
            camera->listed = there;
        }
        return any;
    }
};

struct Stream;

struct Device : gentl::Device {
    Camera* made = nullptr;
    uint32_t generation = 0;
    // the sensor
    bool acquiring = false;
    uint64_t frame_id = 0, frames_to_expose = 0;
    uint64_t pulses_seen = 0;
    nanoseconds trigger_at = no_time;     // a trigger that waits for its delay
    nanoseconds exposure_end = no_time;   // set while exposing
    nanoseconds exposure_begin = no_time;  // of the last frame
    nanoseconds readable_from{0};         // the sensor takes no new exposure before

    Camera& camera() const override { return *made; }
    region::Device& block() const { return *made->block; }
    region::Registers& registers() const { return made->block->registers; }
    bool lost() const override { return made->unplugged() || generation != made->block->plug_generation; }
    std::optional<odd::Description> other = odd::description();
    odd::Memory memory;

    std::string xml() override { return other ? other->text : device_xml; }
    std::string xml_name() const override { return other ? other->name : "spherecal_camera.xml"; }
    std::string xml_url() const override { return other ? other->url : ""; }
    std::unique_ptr<gentl::Stream> make_stream() override;
    void read(Lock& lock, uint64_t at, void* out, size_t size) override;
    void write(Lock& lock, uint64_t at, const void* data, size_t size) override;
    void before_close(Lock&) override;
    void wake() const;
};

int32_t opened_status(const gentl::Device& device) {
    namespace access = gentl::access;
    if (device.lost()) return access::no_access;
    return device.readonly ? access::open_readonly_by_us : access::open_by_us;
}

struct Delivery {
    nanoseconds due;
    Buffer* buffer;
};

struct Stream : gentl::Stream {
    Device& device;
    std::deque<Delivery> on_the_way;
    std::thread worker;
    std::condition_variable work;
    bool stopping = false;
    uint64_t left_to_acquire = 0;
    pixels::Tone tone;
    pixels::Pattern pattern;

    explicit Stream(Device& owned) : gentl::Stream(owned), device(owned) {}
    size_t payload_size(Lock&) override;
    size_t waiting() const override { return odd::is("waiting", "0") ? 0 : output.size(); }
    size_t least_buffers() const override { return size_t(odd::number("buffers", 1)); }
    void start(Lock&, uint64_t frames) override;
    void stop(Lock& lock) override;
    void before_event() override;
};

std::unique_ptr<gentl::Stream> Device::make_stream() { return std::make_unique<Stream>(*this); }

void Device::wake() const {
    if (stream) static_cast<Stream&>(*stream).work.notify_all();
}

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

uint64_t pulses() { return rig().header ? rig().header->line_pulses.load() : 0; }

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
    device.wake();
}

void write_registers(Device& device, uint64_t at, const void* data, size_t size) {
    if (at >= address::commands && at < address::end && size == 4) {
        uint32_t value;
        std::memcpy(&value, data, sizeof value);
        return run_command(device, at, value);
    }
    region::Registers wanted = device.registers();
    if (at + size > sizeof wanted) {
        if (device.other) return device.memory.write(at, static_cast<const uint8_t*>(data), size);
        fail(gentl::invalid_address, "there is no register to write at this address");
    }
    std::memcpy(reinterpret_cast<uint8_t*>(&wanted) + at, data, size);
    check_settings(wanted, device.block());
    const bool format = at < offsetof(region::Registers, acquisition_frame_count);
    if (device.acquiring && format) fail(gentl::access_denied, "the image format is fixed while the camera streams");
    device.registers() = wanted;
    device.wake();
}

void read_registers(const Device& device, uint64_t at, void* out, size_t size) {
    uint8_t all[address::end] = {};
    const Readout readout = read_out(device);
    std::memcpy(all, &device.registers(), sizeof(region::Registers));
    std::memcpy(all + address::readout, &readout, sizeof readout);
    std::memcpy(all + address::user_set_default, &device.block().user_set_default, 4);
    if (at + size > sizeof all && device.other) return device.memory.read(at, static_cast<uint8_t*>(out), size);
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

// A slow link: the caller waits, everybody else goes on.
void reach(Lock& lock, Device& device) {
    if (const uint32_t delay = device.block().port_delay_us) {
        Away away(lock, device);
        std::this_thread::sleep_for(microseconds(delay));
    }
    power_up(device.block());
}

void Device::read(Lock& lock, uint64_t at, void* out, size_t size) {
    reach(lock, *this);
    faulty_port(*this, at, size, false);
    read_registers(*this, at, out, size);
}

void Device::write(Lock& lock, uint64_t at, const void* data, size_t size) {
    reach(lock, *this);
    faulty_port(*this, at, size, true);
    write_registers(*this, at, data, size);
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
    return {device.made, r.width, r.height, r.offset_x, r.offset_y, r.pixel_format, b.padding_bytes,
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

// Writes the image shown, or the pattern. One that was replaced meanwhile is taken again; false where that never ends.
bool write_pixels(Stream& stream, const Shot& shot, uint8_t* out) {
    region::Device& block = *shot.camera->block;
    for (int attempt = 0; attempt < 50; ++attempt) {
        const uint64_t image = block.image_published.load(std::memory_order_acquire);
        block.last_image = image;
        if (image == 0) {
            write_pattern(stream, shot, out);
            return true;
        }
        const uint8_t* slot = rig().slot(shot.camera->index, image);
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
    buffer.format = uint32_t(odd::number("format", shot.format)), buffer.padding = shot.padding;
    buffer.frame_id = odd::number("ids", shot.frame_id), buffer.timestamp_ns = timestamp_ns;
    if (odd::is("stamps", "none")) buffer.timestamp_ns = 0;
    if (odd::is("stamps", "second")) buffer.timestamp_ns %= 1000000000;
    if (const uint64_t first = odd::number("parts", 0)) {
        buffer.parts = {uint32_t(first), buffer.format};
        buffer.payload = 10;  // multi-part
    }
    buffer.big_endian = odd::is("big", "1") && pixels::row_bytes(shot.format, 2) == 4;
    for (size_t i = 0; buffer.big_endian && i + 1 < buffer.size; i += 2) std::swap(buffer.memory[i], buffer.memory[i + 1]);
    buffer.delivered_height = shot.rows;
    buffer.filled = (pixels::row_bytes(shot.format, shot.width) + shot.padding) * shot.rows;
    buffer.incomplete = buffer.too_small || shot.rows < shot.height;
}

Buffer* next_buffer(Stream& stream) {
    region::Device& block = stream.device.block();
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
    Device& device = stream.device;
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
    region::Device& block = stream.device.block();
    while (!stream.on_the_way.empty() && stream.on_the_way.front().due <= now()) {
        Buffer* buffer = stream.on_the_way.front().buffer;
        stream.on_the_way.pop_front();
        gentl::deliver(stream, *buffer);
        ++block.frames_delivered;
        block.frames_incomplete += buffer->incomplete;
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
    const nanoseconds pulse{int64_t(rig().header->line_pulse_ns.load())};
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
    Device& device = stream.device;
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

size_t Stream::payload_size(Lock&) { return ::payload_size(device); }

void Stream::before_event() {
    region::Device& block = device.block();
    crash_if_asked(block);
    if (take(block.event_error_count)) fail(block.event_error, "an error of the stream that was asked for");
}

void Stream::start(Lock&, uint64_t frames) {
    left_to_acquire = frames;
    ++device.block().acquisition_starts;
    worker = std::thread([this] { run(*this); });
}

void Stream::stop(Lock& lock) {
    stopping = true;
    work.notify_all();
    {
        Away away(lock, device);
        worker.join();
    }
    drop_on_the_way(*this);
    stopping = false;
    ++device.block().acquisition_stops;
}

// ---- opening and closing --------------------------------------------------------------------------------------------

std::unique_ptr<gentl::Device> Camera::open(Lock&, int32_t) {
    if (unplugged()) fail(gentl::not_available, "the camera does not answer");
    if (block->open_error != 0) fail(block->open_error, "another program has the camera");
    auto device = std::make_unique<Device>();
    device->made = this;
    device->generation = block->plug_generation;
    power_up(*block);
    ++block->opened;
#if defined(_WIN32)
    block->open_by_pid = uint32_t(GetCurrentProcessId());
#else
    block->open_by_pid = uint32_t(getpid());
#endif
    return device;
}

void Device::before_close(Lock&) {
    if (!lost()) stop_sensor(*this);
    ++block().closed;
    block().open_by_pid = 0;
}

struct SimulatedProducer : gentl::Producer {
    const char* id() const override { return producer_id; }
    const char* model() const override { return "Simulated GenTL producer"; }
    const char* type() const override { return transport; }
    const char* display_name() const override { return "SphereCal simulated cameras"; }
    void open() override {
        rig().open();
        auto link = std::make_unique<Interface>();
        for (uint32_t i = 0; i < rig().count; ++i) {
            auto camera = std::make_unique<Camera>();
            camera->index = i;
            camera->block = &rig().device(i);
            camera->link = link.get();
            link->cameras.push_back(std::move(camera));
        }
        interfaces.push_back(std::move(link));
    }
    void close() override { rig().close(); }
};

}  // namespace

gentl::Producer& gentl::producer() {
    static SimulatedProducer& kept = *new SimulatedProducer;
    return kept;
}
