// A GenTL producer (.cti) for GigE Vision and USB3 Vision cameras of any maker, on libaravis.
//
// Every network interface is a GenTL interface; one more has the cameras at the addresses in SPHERECAL_GIGE_ADDRESSES
// (behind a router, or where broadcasts are blocked), and one the cameras on USB. Registers are reached by libaravis on
// a thread of each camera's own, so that a lost camera costs its caller a second at most: libaravis itself tries for
// three. Left out: multicast, multi-part payloads, cameras that are their own GenTL devices.

#include <arv.h>
#include <dlfcn.h>

#include <atomic>
#include <cstdlib>
#include <sstream>
#include <thread>

#include "gentl_exports.h"
#include "gvcp.h"
#include "gvsp_filter.h"

namespace {

using gentl::Away;
using gentl::Buffer;
using gentl::fail;
using gentl::Feature;
using gentl::Lock;
using gentl::state;
using std::chrono::milliseconds;

constexpr const char* addresses_variable = "SPHERECAL_GIGE_ADDRESSES";
// How long a register may take before the camera is asked whether it still lives, and how often then.
constexpr milliseconds patience{250}, alive_each{150};
constexpr int alive_times = 4;
constexpr milliseconds watch_every{500};
// A camera keeps a controller that was lost, until its heartbeat is missing for 3 s. libaravis' fake camera takes it for
// a heartbeat if anybody asks who has control, so one that is held is not asked meanwhile.
constexpr milliseconds control_lapses{3500};

struct Text {  // a GError, freed
    GError* error = nullptr;
    ~Text() { g_clear_error(&error); }
    std::string said() const { return error ? error->message : "no reason given"; }
};

gentl::Error code_of(const GError* error) {
    if (!error || error->domain != ARV_DEVICE_ERROR) return gentl::io_error;
    switch (error->code) {
        case ARV_DEVICE_ERROR_NOT_CONTROLLER:
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_WRITE_PROTECT:
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED: return gentl::access_denied;
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_NOT_IMPLEMENTED: return gentl::not_implemented;
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_INVALID_PARAMETER: return gentl::invalid_value;
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_INVALID_ADDRESS:
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_BAD_ALIGNMENT: return gentl::invalid_address;
        case ARV_DEVICE_ERROR_PROTOCOL_ERROR_BUSY: return gentl::busy;
        default: return gentl::io_error;
    }
}

[[noreturn]] void fail_as(const GError* error) { fail(code_of(error), error ? error->message : "no reason given"); }

// ---- a camera's own thread ------------------------------------------------------------------------------------------

struct Job {
    std::function<void()> work;
    std::exception_ptr failed;
    bool done = false;
};

// Runs what may take long with a camera. Who waits leaves when the camera no longer answers; the thread ends when it
// can, by itself, and only then is the camera let go.
class Line : public std::enable_shared_from_this<Line> {
   public:
    explicit Line(uint32_t address) : address_(address) {}

    static std::shared_ptr<Line> start(uint32_t address) {
        auto line = std::make_shared<Line>(address);
        std::thread([line] { line->serve(); }).detach();
        return line;
    }

    // Not to be called with the state's lock. Throws what `work` throws, or that the camera does not answer.
    void run(std::function<void()> work) {
        auto job = std::make_shared<Job>();
        job->work = std::move(work);
        std::unique_lock<std::mutex> lock(mutex_);
        if (lost_) fail(gentl::io_error, "the camera does not answer");
        jobs_.push_back(job);
        wake_.notify_all();
        while (!job->done) {
            if (wake_.wait_for(lock, patience, [&] { return job->done || lost_; })) {
                if (!job->done) fail(gentl::io_error, "the camera does not answer");
                break;
            }
            lock.unlock();
            const bool alive = answers();
            lock.lock();
            if (!alive && !job->done) {
                lose();
                fail(gentl::io_error, "the camera does not answer");
            }
        }
        if (job->failed) std::rethrow_exception(job->failed);
    }

    // `work` is done when the thread comes to it, as the last.
    void end(std::function<void()> work) {
        std::unique_lock<std::mutex> lock(mutex_);
        last_ = std::move(work);
        ended_ = true;
        wake_.notify_all();
    }

    // Without waiting, even for a lost camera.
    void post(std::function<void()> work) {
        auto job = std::make_shared<Job>();
        job->work = std::move(work);
        const std::lock_guard<std::mutex> lock(mutex_);
        jobs_.push_back(job);
        wake_.notify_all();
    }

    void watch(bool on) { watched_ = on; }
    void lose() { lost_ = true, wake_.notify_all(); }
    bool lost() const { return lost_; }

   private:
    bool answers() const { return !address_ || gvcp::read_register(address_, gvcp::control_register, alive_each, alive_times); }

    void serve() {
        std::unique_lock<std::mutex> lock(mutex_);
        for (;;) {
            const bool asked = wake_.wait_for(lock, watch_every, [&] { return !jobs_.empty() || ended_; });
            if (!asked) {
                look(lock);
                continue;
            }
            if (jobs_.empty()) break;
            const std::shared_ptr<Job> job = jobs_.front();
            jobs_.pop_front();
            lock.unlock();
            try {
                job->work();
            } catch (...) {
                job->failed = std::current_exception();
            }
            lock.lock();
            job->done = true;
            wake_.notify_all();
        }
        const std::function<void()> last = std::move(last_);  // it may hold this line itself
        last_ = nullptr;
        lock.unlock();
        if (last) last();
    }

    void look(std::unique_lock<std::mutex>& lock) {  // an idle camera may be gone too, or have started again
        if (!address_ || lost_ || !watched_) return;
        lock.unlock();
        const auto control = gvcp::read_register(address_, gvcp::control_register, alive_each, alive_times);
        lock.lock();
        if (!control || (*control & 3) == 0) lose();
    }

    const uint32_t address_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::deque<std::shared_ptr<Job>> jobs_;
    std::function<void()> last_;
    std::atomic<bool> lost_{false}, watched_{false};
    bool ended_ = false;
};

// ---- modules --------------------------------------------------------------------------------------------------------

std::string plain_id(const std::string& text) {
    std::string out;
    for (const char c : text) out += std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' ? c : '-';
    return out;
}

struct Camera : gentl::Camera {
    gvcp::Found found;
    std::string usb;  // libaravis' name of a camera on USB
    std::string apart;  // its address where another camera is like it
    uint32_t host = 0;  // our address on its network, 0 for the routing table's choice
    bool held = false;  // another program had control at the last search
    gentl::Clock::time_point ask_from{};  // not to be asked for its controller before
    std::string problem;  // why it cannot be reached though it answers to a search

    bool on_network() const { return usb.empty(); }
    std::string id() const override {
        if (!on_network()) return plain_id(found.vendor + "-" + found.model + "-" + (found.serial.empty() ? usb : found.serial));
        const std::string serial = found.serial.empty() ? "" : "-" + found.serial;
        return plain_id(found.vendor + "-" + found.model + serial + "-" + found.mac + (apart.empty() ? "" : "-" + apart));
    }
    std::string vendor() const override { return found.vendor; }
    std::string model() const override { return found.model; }
    std::string serial() const override { return found.serial; }
    std::string user_name() const override { return found.user_name; }
    std::string display_name() const override {
        return gentl::Camera::display_name() + (on_network() ? " " + gvcp::address_text(found.address) : "");
    }
    std::string version() const override { return found.version; }
    std::string type() const override { return on_network() ? "GEV" : "U3V"; }
    int32_t access_status() const override {
        namespace access = gentl::access;
        if (opened && opened->lost()) return access::no_access;
        if (opened) return opened->readonly ? access::open_readonly_by_us : access::open_by_us;
        if (!listed || !problem.empty()) return access::no_access;
        return held ? access::is_busy : access::can_write;
    }
    std::unique_ptr<gentl::Device> open(Lock& lock, int32_t how) override;
    void found_held() { ask_from = gentl::Clock::now() + control_lapses; }
};

struct Network : gentl::Interface {
    gvcp::Link link;
    std::vector<uint32_t> addresses;  // of cameras that are asked one by one, on no particular link

    std::string name() const override { return addresses.empty() ? link.name : "addresses"; }
    std::string display_name() const override {
        if (!addresses.empty()) return std::string("GigE Vision, addresses in ") + addresses_variable;
        return "GigE Vision on " + link.name + " (" + gvcp::address_text(link.address) + ")";
    }
    std::string type() const override { return "GEV"; }
    std::vector<Feature> features() override {
        std::vector<Feature> all = Module::features();
        all.push_back(Feature::say("GevInterfaceAddress", [this] { return gvcp::address_text(link.address); }));
        all.push_back(Feature::say("GevInterfaceMask", [this] { return gvcp::address_text(link.mask); }));
        return all;
    }
    bool refresh(Lock& lock, uint64_t timeout_ms) override;

   private:
    enum class Control { free, held, not_asked };  // not asked: it is ours, or was held a moment ago
    Camera* camera_of(const gvcp::Found& one, const std::vector<gvcp::Found>& all);
    bool merge(const gvcp::Found& one, const std::vector<gvcp::Found>& all, Control control, const std::string& problem);
};

struct Usb : gentl::Interface {
    std::string name() const override { return "usb3"; }
    std::string display_name() const override { return "USB3 Vision"; }
    std::string type() const override { return "U3V"; }
    bool refresh(Lock& lock, uint64_t timeout_ms) override;
};

struct Stream;

struct Device : gentl::Device {
    Camera* made = nullptr;
    ArvDevice* arv = nullptr;
    std::shared_ptr<Line> line;
    std::string description;
    uint64_t known_payload = 0;

    Camera& camera() const override { return *made; }
    bool lost() const override { return line->lost(); }
    bool big_endian() const override { return made->on_network(); }
    std::string xml() override { return description; }
    std::unique_ptr<gentl::Stream> make_stream() override;
    void read(Lock& lock, uint64_t at, void* out, size_t size) override;
    void write(Lock& lock, uint64_t at, const void* data, size_t size) override;
    void before_close(Lock& lock) override;
    std::vector<Feature> features() override;
};

struct Settings {  // of the next start; the defaults are libaravis' own, but packet sockets have no filter of ours
    int64_t resend = 1, packet_timeout_ms = 20, frame_retention_ms = 100, socket_bytes = 0, packet_socket = 0;
    int64_t packet_size_search = 1;
};

struct Shape {
    uint32_t x = 0, y = 0, width = 0, height = 0, padding = 0, format = 0;
};

// What libaravis calls back: shared with libaravis' stream, whose thread may outlast ours where a camera is lost.
struct Receiver {
    Stream* stream;  // null when ours is closed; guarded by the state's lock
};

struct Stream : gentl::Stream {
    Device& device;
    ArvStream* arv = nullptr;  // while it runs; it calls back on a thread of its own
    Settings settings;
    Shape shape;  // of its last whole frame
    uint32_t packet_size = 0;
    size_t guarded_size = 0;  // of the smallest buffer that libaravis has
    uint64_t left_to_acquire = 0, missing_before = 0, kept_counts[9] = {};
    int64_t last_missing = 0, incomplete_frames = 0;

    const std::shared_ptr<Receiver> receiver = std::make_shared<Receiver>(Receiver{this});

    explicit Stream(Device& owned) : gentl::Stream(owned), device(owned) {}
    ~Stream() override { receiver->stream = nullptr; }
    size_t payload_size(Lock& lock) override;
    uint64_t frames_lost() const override { return count_of(0); }
    void give_input_back(Lock& lock) override;
    void queued(Buffer& buffer) override;
    void start(Lock& lock, uint64_t frames) override;
    void stop(Lock& lock) override;
    void before_event() override;
    std::vector<Feature> features() override;
    void take_finished();
    uint64_t count_of(size_t which) const;

   private:
    void push(Buffer& buffer);
    void guard(size_t buffer_size);
    void take_unfilled();
    void let_go(ArvStream* stream) const;
    void fill(Buffer& buffer, ArvBuffer* from);
};

// ---- finding --------------------------------------------------------------------------------------------------------

Camera* known(gentl::Interface& link, const std::string& id) {
    for (const auto& camera : link.cameras)
        if (camera->id() == id) return static_cast<Camera*>(camera.get());
    return nullptr;
}

// Why a camera that answered to a search by broadcast cannot be spoken to alone.
std::string problem_of(const gvcp::Found& one, const std::vector<gvcp::Found>& all, const gvcp::Link& link) {
    const std::string at = gvcp::address_text(one.address);
    for (const gvcp::Found& other : all)
        if (other.address == one.address && !other.alike(one))
            return "the cameras " + one.serial + " and " + other.serial + " have the same address " + at;
    if (link.index && gvcp::local_address(one.address) != link.address)
        return "its address " + at + " is not in the network of " + link.name + ", " + gvcp::address_text(link.address) +
               " mask " + gvcp::address_text(link.mask);
    return "";
}

// The camera that was found before at this address, else one like it whose address nobody has now; null for a new one.
Camera* Network::camera_of(const gvcp::Found& one, const std::vector<gvcp::Found>& all) {
    Camera* moved = nullptr;
    for (const auto& each : cameras) {
        auto& camera = static_cast<Camera&>(*each);
        if (camera.found.same(one)) return &camera;
        const auto there = [&](const gvcp::Found& other) { return other.same(camera.found); };
        if (camera.found.alike(one) && !camera.opened && std::none_of(all.begin(), all.end(), there)) moved = &camera;
    }
    return moved;
}

bool Network::merge(
    const gvcp::Found& one, const std::vector<gvcp::Found>& all, Control control, const std::string& problem) {
    Camera* camera = camera_of(one, all);
    if (!camera) {
        auto made = std::make_unique<Camera>();
        made->found = one;
        const auto twin = [&](const gvcp::Found& other) { return other.alike(one) && !other.same(one); };
        if (std::any_of(all.begin(), all.end(), twin) || known(*this, made->id())) made->apart = gvcp::address_text(one.address);
        camera = made.get();
        cameras.push_back(std::move(made));
        camera->gentl::Camera::link = this;
    }
    const bool news = !camera->listed;
    camera->found = one, camera->held = control != Control::free, camera->problem = problem;
    camera->host = addresses.empty() ? link.address : 0;
    camera->listed = true;
    // only if it was asked: else the time to ask, passing during a search, would be put off again and again
    if (control == Control::held) camera->found_held();
    return news;
}

bool Network::refresh(Lock& lock, uint64_t timeout_ms) {
    const gentl::Handle self = static_cast<gentl::Module*>(this);
    const unsigned index = addresses.empty() ? link.index : 0;
    const std::vector<uint32_t> asked = addresses;
    const gvcp::Link on = link;
    std::vector<gvcp::Found> quiet;
    for (const auto& camera : cameras) {
        const bool ours = camera->opened && !camera->opened->lost();
        if (ours || gentl::Clock::now() < static_cast<Camera&>(*camera).ask_from)
            quiet.push_back(static_cast<Camera&>(*camera).found);
    }
    std::vector<std::tuple<gvcp::Found, Control, std::string>> found;
    lock.unlock();
    const milliseconds timeout(std::min<uint64_t>(std::max<uint64_t>(timeout_ms, 50), 1000));
    const std::vector<gvcp::Found> all = gvcp::search(index, asked, timeout);
    for (const gvcp::Found& one : all) {
        const std::string problem = problem_of(one, all, index ? on : gvcp::Link{});
        Control control = Control::free;
        if (std::any_of(quiet.begin(), quiet.end(), [&](const gvcp::Found& known) { return known.same(one); })) {
            control = Control::not_asked;
        } else if (problem.empty()) {
            const auto by = gvcp::read_register(one.address, gvcp::control_register, milliseconds(100), 2);
            if (by && (*by & 3) != 0) control = Control::held;
        }
        found.push_back({one, control, problem});
    }
    lock.lock();
    gentl::find<gentl::Interface>(self, "interface");  // it may have been closed meanwhile
    std::vector<bool> before;
    for (const auto& camera : cameras) {
        before.push_back(camera->listed);
        camera->listed = camera->opened && !camera->opened->lost();  // a busy line may lose the answer
    }
    const size_t old = cameras.size();
    for (const auto& [one, control, problem] : found) merge(one, all, control, problem);
    bool changed = cameras.size() != old;
    for (size_t i = 0; i < old; ++i) changed |= cameras[i]->listed != before[i];
    return changed;
}

std::string said(const char* text) { return text ? text : ""; }

bool Usb::refresh(Lock& lock, uint64_t) {
    const gentl::Handle self = static_cast<gentl::Module*>(this);
    std::vector<Camera> found;
    lock.unlock();
    {
        static std::mutex one_at_a_time;  // libaravis keeps one list
        const std::lock_guard<std::mutex> guard(one_at_a_time);
        arv_update_device_list();
        for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
            if (said(arv_get_device_protocol(i)) != "USB3Vision") continue;
            Camera camera;
            camera.usb = said(arv_get_device_id(i));
            camera.found.vendor = said(arv_get_device_vendor(i)), camera.found.model = said(arv_get_device_model(i));
            camera.found.serial = said(arv_get_device_serial_nbr(i));
            found.push_back(camera);
        }
    }
    lock.lock();
    gentl::find<gentl::Interface>(self, "interface");
    bool changed = false;
    for (const auto& camera : cameras) {
        const bool there = std::any_of(found.begin(), found.end(), [&](const Camera& c) { return c.id() == camera->id(); });
        changed |= camera->listed != there;
        camera->listed = there;
    }
    for (const Camera& one : found)
        if (!known(*this, one.id())) {
            cameras.push_back(std::make_unique<Camera>(one));
            cameras.back()->gentl::Camera::link = this, cameras.back()->listed = changed = true;
        }
    return changed;
}

// ---- opening --------------------------------------------------------------------------------------------------------

GInetAddress* inet(uint32_t address) {
    const uint32_t raw = htonl(address);
    return g_inet_address_new_from_bytes(reinterpret_cast<const guint8*>(&raw), G_SOCKET_FAMILY_IPV4);
}

ArvDevice* open_network(uint32_t host, uint32_t address, bool readonly) {
    Text text;
    GInetAddress *here = inet(host), *there = inet(address);
    ArvDevice* device = arv_gv_device_new(here, there, &text.error);
    g_object_unref(here), g_object_unref(there);
    if (!device) fail(gentl::not_available, text.said());
    const bool control = arv_gv_device_is_controller(ARV_GV_DEVICE(device));
    if (readonly && control) arv_gv_device_leave_control(ARV_GV_DEVICE(device), nullptr);
    if (readonly || control) return device;
    g_object_unref(device);
    fail(gentl::access_denied, "another program has control of the camera");
}

ArvDevice* open_usb(const std::string& name) {
    Text text;
    ArvDevice* device = arv_open_device(name.c_str(), &text.error);
    if (!device) fail(gentl::not_available, text.said());
    return device;
}

void camera_is_lost(ArvDevice*, gpointer line) { static_cast<Line*>(line)->lose(); }

struct Opening {  // outlives the caller where that leaves early
    ArvDevice* device = nullptr;
    std::string xml;
};

void open_now(Opening& opening, const std::string& usb, uint32_t host, uint32_t address, bool readonly) {
    static std::mutex one_at_a_time;  // libaravis 0.8.26 reads two descriptions at once wrongly
    const std::lock_guard<std::mutex> guard(one_at_a_time);
    opening.device = usb.empty() ? open_network(host, address, readonly) : open_usb(usb);
    size_t size = 0;
    const char* xml = arv_device_get_genicam_xml(opening.device, &size);
    if (xml) opening.xml.assign(xml, size);
    // A program that crashed or lost its line left the camera sending, to an address where nobody is.
    if (!readonly) arv_device_execute_command(opening.device, "AcquisitionStop", nullptr);
}

std::unique_ptr<gentl::Device> Camera::open(Lock& lock, int32_t how) {
    const bool readonly = how == gentl::access::readonly;
    const uint32_t address = found.address;
    const std::string name = usb;
    uint32_t from = host;
    if (!problem.empty()) fail(gentl::not_available, problem);
    if (!readonly && gentl::Clock::now() < ask_from)
        fail(gentl::access_denied, "another program has control of the camera");
    auto opening = std::make_shared<Opening>();
    std::shared_ptr<Line> line;
    lock.unlock();
    try {
        if (name.empty()) {
            const auto control = gvcp::read_register(address, gvcp::control_register, alive_each, alive_times);
            if (!control) fail(gentl::not_available, "the camera at " + gvcp::address_text(address) + " does not answer");
            if (!readonly && (*control & 3)) fail(gentl::access_denied, "another program has control of the camera");
            from = gvcp::local_address(address).value_or(from);
        }
        line = Line::start(name.empty() ? address : 0);
        line->run([=] { open_now(*opening, name, from, address, readonly); });
    } catch (const gentl::Failure& failure) {
        if (line)
            line->end([opening] {
                if (opening->device) g_object_unref(opening->device);
            });
        lock.lock();
        if (failure.code == gentl::access_denied) found_held();
        throw;
    }
    lock.lock();
    if (opened) {  // by another thread meanwhile
        line->end([opening] { g_object_unref(opening->device); });
        fail(gentl::resource_in_use, "this program has the camera open already");
    }
    auto device = std::make_unique<Device>();
    device->made = this;
    device->arv = opening->device, device->description = opening->xml, device->line = line;
    g_signal_connect(device->arv, "control-lost", G_CALLBACK(camera_is_lost), line.get());
    line->watch(!readonly);
    held = false;
    return device;
}

void Device::before_close(Lock&) {
    ArvDevice* last = arv;
    const std::shared_ptr<Line> kept = line;
    line->watch(false);
    line->end([last, kept] {
        g_signal_handlers_disconnect_by_data(last, kept.get());
        g_object_unref(last);
    });
}

std::vector<Feature> Device::features() {
    std::vector<Feature> all = Module::features();
    const gvcp::Found& about = made->found;
    all.push_back(Feature::say("GevDeviceAddress", [&] { return gvcp::address_text(about.address); }));
    all.push_back(Feature::say("GevDeviceMask", [&] { return gvcp::address_text(about.mask); }));
    all.push_back(Feature::say("GevDeviceMACAddress", [&] { return about.mac; }));
    all.push_back(Feature::say("GevHostInterface", [this] { return made->link->name(); }));
    return all;
}

// ---- registers ------------------------------------------------------------------------------------------------------

// One register or a block, as the camera's bytes. Blocks go in whole words, as GigE Vision wants them.
void read_bytes(ArvDevice* device, bool network, uint64_t at, uint8_t* out, size_t size) {
    Text text;
    const uint64_t from = network ? at & ~uint64_t(3) : at, end = network ? (at + size + 3) & ~uint64_t(3) : at + size;
    std::vector<uint8_t> words(size_t(end - from));
    if (network && words.size() == 4) {
        uint32_t value = 0;
        if (!arv_device_read_register(device, from, &value, &text.error)) fail_as(text.error);
        value = htonl(value);
        std::memcpy(words.data(), &value, 4);
    } else if (!arv_device_read_memory(device, from, uint32_t(words.size()), words.data(), &text.error)) {
        fail_as(text.error);
    }
    std::memcpy(out, words.data() + (at - from), size);
}

void write_bytes(ArvDevice* device, bool network, uint64_t at, const uint8_t* data, size_t size) {
    Text text;
    if (network && (at % 4 || size % 4)) fail(gentl::invalid_address, "GigE Vision writes whole words only");
    if (network && size == 4) {
        uint32_t value;
        std::memcpy(&value, data, 4);
        if (!arv_device_write_register(device, at, ntohl(value), &text.error)) fail_as(text.error);
    } else {
        std::vector<uint8_t> copy(data, data + size);
        if (!arv_device_write_memory(device, at, uint32_t(size), copy.data(), &text.error)) fail_as(text.error);
    }
}

constexpr size_t most_at_once = 1 << 20;

void Device::read(Lock& lock, uint64_t at, void* out, size_t size) {
    if (size == 0 || size > most_at_once) fail(gentl::invalid_parameter, "this many bytes cannot be read at once");
    auto got = std::make_shared<std::vector<uint8_t>>(size);  // the caller may leave early
    ArvDevice* from = arv;
    const bool network = made->on_network();
    {
        Away away(lock, *this);
        line->run([=] { read_bytes(from, network, at, got->data(), size); });
    }
    std::memcpy(out, got->data(), size);
}

void Device::write(Lock& lock, uint64_t at, const void* data, size_t size) {
    if (size == 0 || size > most_at_once) fail(gentl::invalid_parameter, "this many bytes cannot be written at once");
    const auto* begin = static_cast<const uint8_t*>(data);
    auto wanted = std::make_shared<std::vector<uint8_t>>(begin, begin + size);
    ArvDevice* to = arv;
    const bool network = made->on_network();
    Away away(lock, *this);
    line->run([=] { write_bytes(to, network, at, wanted->data(), size); });
}

// ---- streams --------------------------------------------------------------------------------------------------------

std::unique_ptr<gentl::Stream> Device::make_stream() { return std::make_unique<Stream>(*this); }

size_t Stream::payload_size(Lock& lock) {
    if (running && device.known_payload) return size_t(device.known_payload);
    ArvDevice* from = device.arv;
    auto size = std::make_shared<int64_t>(0);
    {
        Away away(lock, device);
        device.line->run([=] {
            Text text;
            *size = arv_device_get_integer_feature_value(from, "PayloadSize", &text.error);
            if (text.error) fail_as(text.error);
        });
    }
    device.known_payload = uint64_t(std::max<int64_t>(*size, 0));
    return size_t(device.known_payload);
}

// libaravis' names of what it counts, and ours. Missing packets are counted from the first that is missing to the end of
// the frame, whether later ones came or not.
constexpr struct {
    const char *theirs, *ours;
} counts[] = {
    {"n_underruns", "StreamUnderrunCount"},           {"n_failures", "StreamFailedFrameCount"},
    {"n_missing_frames", "StreamMissingFrameCount"},  {"n_received_packets", "StreamReceivedPacketCount"},
    {"n_missing_packets", "StreamMissingPacketCount"}, {"n_resend_requests", "StreamResendRequestCount"},
    {"n_resent_packets", "StreamResentPacketCount"},  {"n_transferred_bytes", "StreamTransferredBytes"},
    {"n_timeouts", "StreamTimeoutCount"},
};
enum { underruns, failures, missing_frames, received_packets, missing_packets };
static_assert(std::size(counts) == 9, "as many as are kept");

bool counted(ArvStream* stream, const char* name) {  // USB's streams count less
    for (unsigned i = 0; i < arv_stream_get_n_infos(stream); ++i)
        if (said(arv_stream_get_info_name(stream, i)) == name) return true;
    return false;
}

uint64_t Stream::count_of(size_t which) const {
    if (!arv) return kept_counts[which];
    return counted(arv, counts[which].theirs) ? arv_stream_get_info_uint64_by_name(arv, counts[which].theirs) : 0;
}

std::vector<Feature> Stream::features() {
    std::vector<Feature> all = Module::features();
    for (size_t i = 0; i < std::size(counts); ++i)
        all.push_back(Feature::count(counts[i].ours, [this, i] { return int64_t(count_of(i)); }));
    all.push_back(Feature::count("StreamIncompleteFrameCount", [this] { return incomplete_frames; }));
    all.push_back(Feature::count("StreamLastIncompleteMissingPackets", [this] { return last_missing; }));
    const auto setting = [&](const char* name, int64_t& value, int64_t most) {
        all.push_back(Feature::count(name, [&value] { return value; }, [&value, most](int64_t wanted) {
            if (wanted < 0 || wanted > most) fail(gentl::invalid_value, "out of range");
            value = wanted;
        }));
    };
    setting("StreamPacketResend", settings.resend, 1);
    setting("StreamPacketTimeoutMs", settings.packet_timeout_ms, 10000);
    setting("StreamFrameRetentionMs", settings.frame_retention_ms, 60000);
    setting("StreamSocketBufferBytes", settings.socket_bytes, 1 << 30);  // 0: as large as a frame
    setting("StreamPacketSocket", settings.packet_socket, 1);
    setting("StreamPacketSizeSearch", settings.packet_size_search, 2);  // 0 never, 1 where the present size fails, 2 largest
    return all;
}

void callback(void* user, ArvStreamCallbackType kind, ArvBuffer*) {
    if (kind != ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE) return;
    const Lock lock(state().mutex);
    if (Stream* stream = static_cast<std::shared_ptr<Receiver>*>(user)->get()->stream) stream->take_finished();
}

void forget(gpointer user) { delete static_cast<std::shared_ptr<Receiver>*>(user); }

struct Making {  // outlives the caller where that leaves early
    std::mutex mutex;
    ArvStream* made = nullptr;
    uint32_t packet_size = 0;
    bool left = false;
};

ArvStream* make_stream(ArvDevice* from, const Settings& settings, const std::shared_ptr<Receiver>& receiver) {
    if (ARV_IS_GV_DEVICE(from)) {
        const ArvGvPacketSizeAdjustment search[] = {ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER,
                                                    ARV_GV_PACKET_SIZE_ADJUSTMENT_ON_FAILURE,
                                                    ARV_GV_PACKET_SIZE_ADJUSTMENT_ALWAYS};
        arv_gv_device_set_packet_size_adjustment(ARV_GV_DEVICE(from), search[settings.packet_size_search]);
        arv_gv_device_set_stream_options(ARV_GV_DEVICE(from), settings.packet_socket
                                                                  ? ARV_GV_STREAM_OPTION_NONE
                                                                  : ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    }
    Text text;
    auto user = std::make_unique<std::shared_ptr<Receiver>>(receiver);
    ArvStream* made = arv_device_create_stream(from, callback, user.get(), &text.error);
    if (!made) fail_as(text.error);
    g_object_set_data_full(G_OBJECT(made), "spherecal-receiver", user.release(), forget);
    if (ARV_IS_GV_STREAM(made))
        g_object_set(made, "packet-resend",
                     settings.resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
                     "packet-timeout", guint(settings.packet_timeout_ms * 1000), "frame-retention",
                     guint(settings.frame_retention_ms * 1000), "socket-buffer",
                     settings.socket_bytes ? ARV_GV_STREAM_SOCKET_BUFFER_FIXED : ARV_GV_STREAM_SOCKET_BUFFER_AUTO,
                     "socket-buffer-size", gint(settings.socket_bytes), nullptr);
    return made;
}

void Stream::guard(size_t buffer_size) {
    if (!ARV_IS_GV_STREAM(arv) || (guarded_size && guarded_size <= buffer_size)) return;
    guarded_size = buffer_size;
    const int socket = gvsp::socket_on(arv_gv_stream_get_port(ARV_GV_STREAM(arv)));
    if (socket < 0) return;
    gvsp::filter(device.made->found.address, packet_size, buffer_size).attach(socket);
    // libaravis makes room for a frame when the first packet has come: too late for the first frame
    const int room = settings.socket_bytes ? int(settings.socket_bytes) : int(std::min<size_t>(buffer_size, 1 << 30));
    setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
}

void Stream::push(Buffer& buffer) {
    guard(buffer.size);
    buffer.state = Buffer::filling;
    arv_stream_push_buffer(arv, arv_buffer_new_full(buffer.size, buffer.memory, &buffer, nullptr));
}

void Stream::queued(Buffer& buffer) {
    if (arv && !changing)  // changing: `start` pushes what is queued meanwhile
        push(buffer);
    else
        input.push_back(&buffer);
}

void Stream::start(Lock& lock, uint64_t frames) {
    left_to_acquire = frames;
    missing_before = 0, last_missing = incomplete_frames = 0, shape = {};
    std::fill(std::begin(kept_counts), std::end(kept_counts), 0);
    payload_size(lock);
    auto making = std::make_shared<Making>();
    ArvDevice* from = device.arv;
    const Settings chosen = settings;
    try {
        Away away(lock, device);
        device.line->run([=, to = receiver] {
            ArvStream* made = make_stream(from, chosen, to);
            const std::lock_guard<std::mutex> guard(making->mutex);
            making->made = made;
            if (ARV_IS_GV_DEVICE(from)) making->packet_size = arv_gv_device_get_packet_size(ARV_GV_DEVICE(from), nullptr);
            if (making->left) g_object_unref(made);
        });
    } catch (...) {
        const std::lock_guard<std::mutex> guard(making->mutex);
        if (ArvStream* made = making->made) device.line->post([made] { g_object_unref(made); });  // it may take seconds
        making->left = true;
        throw;
    }
    arv = making->made, packet_size = making->packet_size, guarded_size = 0;
    while (!input.empty()) {
        Buffer& buffer = *input.front();
        input.pop_front();
        push(buffer);
    }
}

// Afterwards nothing is written into its buffers. Starting its thread and ending it for good write registers, for which
// libaravis waits seconds where the camera is lost; that is left to the camera's thread, and without a thread that has
// been stopped libaravis complains.
void Stream::let_go(ArvStream* stream) const {
    if (!device.lost()) return g_object_unref(stream);
    arv_stream_stop_thread(stream, TRUE);
    device.line->post([stream] {
        arv_stream_start_thread(stream);
        g_object_unref(stream);
    });
}

void Stream::stop(Lock& lock) {
    ArvStream* ending = arv;
    if (!ending) return;  // given up already
    for (size_t i = 0; i < std::size(counts); ++i) kept_counts[i] = count_of(i);
    arv = nullptr;
    {
        Away away(lock, device);
        let_go(ending);
    }
    take_unfilled();
}

void Stream::take_unfilled() {
    for (const auto& buffer : buffers) {
        if (buffer->state != Buffer::filling) continue;
        buffer->state = Buffer::queued;
        input.push_back(buffer.get());
    }
}

// libaravis lets go of its buffers only while its thread does not run.
void Stream::give_input_back(Lock& lock) {
    if (!running || changing || !arv) return;
    changing = true;
    ArvStream* held = arv;
    const bool gone = device.lost();
    if (gone) arv = nullptr;
    {
        Away away(lock, device);
        if (gone) {
            let_go(held);
        } else {
            arv_stream_stop_thread(held, TRUE);
            arv_stream_start_thread(held);
        }
    }
    take_unfilled();
    changing = false;
    state().back.notify_all();
}

void Stream::before_event() {
    if (device.lost() && output.empty()) fail(gentl::io_error, "the camera does not answer");
}

constexpr size_t multipart = 10;

size_t gentl_payload(ArvBufferPayloadType kind) {
    switch (kind) {
        case ARV_BUFFER_PAYLOAD_TYPE_IMAGE:
        case ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA: return gentl::payload_is_image;
        case ARV_BUFFER_PAYLOAD_TYPE_RAWDATA: return 2;
        case ARV_BUFFER_PAYLOAD_TYPE_FILE: return 3;
        case ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA: return 4;
        case ARV_BUFFER_PAYLOAD_TYPE_JPEG: return 5;
        case ARV_BUFFER_PAYLOAD_TYPE_JPEG2000: return 6;
        case ARV_BUFFER_PAYLOAD_TYPE_H264: return 7;
        case ARV_BUFFER_PAYLOAD_TYPE_MULTIPART: return multipart;
        default: return 0;
    }
}

bool of_pixels(ArvBufferPartDataType kind) {
    return kind >= ARV_BUFFER_PART_DATA_TYPE_2D_IMAGE && kind <= ARV_BUFFER_PART_DATA_TYPE_CONFIDENCE_MAP;
}

void Stream::fill(Buffer& buffer, ArvBuffer* from) {
    const ArvBufferStatus status = arv_buffer_get_status(from);
    const uint64_t missing = count_of(missing_packets);
    buffer.missing_packets = size_t(missing - missing_before);
    missing_before = missing;
    buffer.incomplete = status != ARV_BUFFER_STATUS_SUCCESS;
    buffer.too_small = status == ARV_BUFFER_STATUS_SIZE_MISMATCH ||
                       (buffer.incomplete && buffer.size < device.known_payload);
    arv_buffer_get_data(from, &buffer.filled);
    buffer.payload = gentl_payload(arv_buffer_get_payload_type(from));
    buffer.chunks = arv_buffer_has_chunks(from);
    buffer.frame_id = arv_buffer_get_frame_id(from);
    buffer.timestamp_ns = arv_buffer_get_timestamp(from);
    // libaravis describes whole frames only; the others of the stream have the same shape
    const bool described = buffer.payload == gentl::payload_is_image || buffer.payload == multipart;
    if (!buffer.incomplete && described && of_pixels(arv_buffer_get_part_data_type(from, 0))) {
        gint x = 0, y = 0, width = 0, height = 0, x_padding = 0, y_padding = 0;
        arv_buffer_get_part_region(from, 0, &x, &y, &width, &height);
        arv_buffer_get_part_padding(from, 0, &x_padding, &y_padding);
        shape = {uint32_t(x), uint32_t(y), uint32_t(width), uint32_t(height), uint32_t(x_padding),
                 arv_buffer_get_part_pixel_format(from, 0)};
    }
    buffer.x = shape.x, buffer.y = shape.y, buffer.width = shape.width, buffer.height = shape.height;
    buffer.padding = shape.padding, buffer.format = shape.format;
    buffer.delivered_height = buffer.height;
    if (!buffer.incomplete) return;
    ++incomplete_frames;
    last_missing = int64_t(buffer.missing_packets);
}

void Stream::take_finished() {  // with the state's lock
    while (ArvBuffer* got = arv ? arv_stream_try_pop_buffer(arv) : nullptr) {
        auto& buffer = *static_cast<Buffer*>(const_cast<void*>(arv_buffer_get_user_data(got)));
        fill(buffer, got);
        g_object_unref(got);
        ++started;
        if (left_to_acquire == 0) {
            push(buffer);
            continue;
        }
        if (left_to_acquire != gentl::infinite) --left_to_acquire;
        gentl::deliver(*this, buffer);
    }
}

// ---- the producer ---------------------------------------------------------------------------------------------------

std::vector<uint32_t> listed_addresses() {
    std::vector<uint32_t> found;
    const char* list = std::getenv(addresses_variable);
    std::string plain = list ? list : "";
    std::replace(plain.begin(), plain.end(), ',', ' ');
    std::istringstream words(plain);
    for (std::string word; words >> word;) {
        in_addr raw{};
        if (inet_pton(AF_INET, word.c_str(), &raw) == 1) found.push_back(ntohl(raw.s_addr));
    }
    return found;
}

// An action command: cameras with these keys act together, at `time_ns` of their common clock where that is not 0.
struct Action {
    int64_t device_key = 0, group_key = 0, group_mask = 0, time_ns = 0;

    void send() const {
        gvcp::Bytes payload;
        gvcp::put32(payload, uint32_t(device_key));
        gvcp::put32(payload, uint32_t(group_key));
        gvcp::put32(payload, uint32_t(group_mask));
        if (time_ns) gvcp::put32(payload, uint32_t(uint64_t(time_ns) >> 32)), gvcp::put32(payload, uint32_t(time_ns));
        const gvcp::Socket socket;
        const gvcp::Bytes message =
            gvcp::command(gvcp::action_command, time_ns ? gvcp::has_time : 0, gvcp::next_id(), payload);
        for (const gvcp::Link& link : gvcp::links()) socket.send(INADDR_BROADCAST, message, link.index);
    }
};

struct AravisProducer : gentl::Producer {
    Action action;

    const char* id() const override { return "spherecal-aravis"; }
    const char* model() const override { return "GenTL producer on libaravis"; }
    const char* type() const override { return "Mixed"; }
    const char* display_name() const override { return "SphereCal: GigE Vision and USB3 Vision by Aravis"; }

    void open() override {
        for (unsigned i = 0; i < arv_get_n_interfaces(); ++i)  // networks are searched here
            if (said(arv_get_interface_id(i)) != "USB3Vision") arv_disable_interface(arv_get_interface_id(i));
        add_networks();
        if (const std::vector<uint32_t> addresses = listed_addresses(); !addresses.empty()) {
            auto network = std::make_unique<Network>();
            network->addresses = addresses;
            interfaces.push_back(std::move(network));
        }
        interfaces.push_back(std::make_unique<Usb>());
    }
    void close() override {}
    bool refresh(Lock&) override { return add_networks(); }

    std::vector<Feature> features() override {
        std::vector<Feature> all;
        const auto value = [&](const char* name, int64_t& place) {
            all.push_back(Feature::count(name, [&place] { return place; }, [&place](int64_t v) { place = v; }));
        };
        value("ActionDeviceKey", action.device_key);
        value("ActionGroupKey", action.group_key);
        value("ActionGroupMask", action.group_mask);
        value("ActionScheduledTime", action.time_ns);
        all.push_back(Feature::run("ActionCommand", [this](int64_t) { action.send(); }));
        return all;
    }

   private:
    // An interface that has gone stays, without cameras: a client may have it open.
    bool add_networks() {
        bool any = false;
        for (const gvcp::Link& link : gvcp::links()) {
            Network* known = nullptr;
            for (const auto& one : interfaces)
                if (one->name() == link.name) known = dynamic_cast<Network*>(one.get());
            if (known) {
                known->link = link;
                continue;
            }
            auto network = std::make_unique<Network>();
            network->link = link;
            interfaces.push_back(std::move(network));
            any = true;
        }
        return any;
    }
};

}  // namespace

gentl::Producer& gentl::producer() {
    static AravisProducer& kept = *new AravisProducer;
    return kept;
}
