// A GigE Vision camera in this machine: libaravis' fake camera, with a serial number and a sensor size of its own, and
// with pictures that another program puts into shared memory.
//
//   fake_camera INTERFACE SERIAL WIDTH HEIGHT MAC MASK PICTURES_FD
//
// PICTURES_FD is an open file of: 64 bytes of head (the first 8: how many pictures were put there so far), then two
// pictures of WIDTH x HEIGHT bytes; number n is in place n mod 2. Without a picture the fake camera shows its ramp.
// Its clock is simulated as synchronised by IEEE 1588 while PtpEnable is on: every camera here has this computer's, some
// hundred nanoseconds apart. It obeys action commands, also scheduled ones, and sends test packets; libaravis' fake
// camera knows none of these.
// Says "ready" when it answers, and ends with its standard input. "address IP" asks for a new address (FORCEIP),
// "keep IP" says which one it is to start with from now on.

#include <arpa/inet.h>
#include <arv.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/mman.h>
#include <linux/filter.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>

namespace {

constexpr size_t head_bytes = 64;

struct Pictures {
    const uint8_t* memory = nullptr;
    size_t width = 0, height = 0;
    uint32_t shown = 0;
    std::atomic<int64_t> acted_ns{0};  // when the action was that the next picture is of
};

// The features that libaravis' description leaves out and every real camera has.
constexpr const char* names =
    "<pFeature>DeviceSerialNumber</pFeature><pFeature>DeviceUserID</pFeature><pFeature>GevSCPSPacketSize</pFeature>"
    "<pFeature>GevSCPD</pFeature><pFeature>GevTimestampTickFrequency</pFeature><pFeature>TriggerMode</pFeature>"
    "<pFeature>TriggerSource</pFeature><pFeature>AcquisitionFrameRate</pFeature><pFeature>PtpEnable</pFeature>"
    "<pFeature>PtpDataSetLatch</pFeature><pFeature>PtpStatus</pFeature><pFeature>PtpOffsetFromMaster</pFeature>"
    "<pFeature>TimestampLatch</pFeature><pFeature>TimestampLatchValue</pFeature><pFeature>ActionDeviceKey</pFeature>"
    "<pFeature>ActionGroupKey</pFeature><pFeature>ActionGroupMask</pFeature>";
constexpr const char* nodes = R"(
<StringReg Name="DeviceSerialNumber"><Address>0xd8</Address><Length>16</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort></StringReg>
<StringReg Name="DeviceUserID"><Address>0xe8</Address><Length>16</Length><AccessMode>RW</AccessMode>
<pPort>Device</pPort></StringReg>
<Integer Name="GevSCPSPacketSize"><pValue>PacketSizeReg</pValue><Min>576</Min><Max>9000</Max><Inc>4</Inc></Integer>
<MaskedIntReg Name="PacketSizeReg"><Address>0xd04</Address><Length>4</Length><AccessMode>RW</AccessMode>
<pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>
<IntReg Name="GevSCPD"><Address>0xd08</Address><Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>
<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
<IntReg Name="GevTimestampTickFrequency"><Address>0x93c</Address><Length>8</Length><AccessMode>RO</AccessMode>
<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
)";

// Registers of our own, behind those of libaravis' fake camera.
enum : uint32_t {
    ptp_enable = 0x8000, ptp_latch = 0x8004, ptp_status = 0x8008, trigger_source = 0x800C, ptp_offset = 0x8010,
    action_device_key = 0x8018, action_group_key = 0x801C, action_group_mask = 0x8020, time_latch = 0x8024,
    latched_time = 0x8028,
};

// Registers of every GigE Vision camera.
enum : uint32_t {
    ip_configuration = 0x14, persistent_address = 0x64c, stream_port = 0xd00, packet_size = 0xd04, stream_address = 0xd18,
    fire = 1u << 31,
};

std::string integer(const char* name, uint32_t at, int bytes, const char* access) {
    return std::string("<IntReg Name=\"") + name + "\"><Address>" + std::to_string(at) + "</Address><Length>" +
           std::to_string(bytes) + "</Length><AccessMode>" + access +
           "</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>" + (bytes == 8 ? "S" : "Uns") +
           "igned</Sign><Endianess>BigEndian</Endianess></IntReg>\n";
}

std::string command(const char* name, uint32_t at) {
    const std::string reg = std::string(name) + "Reg";
    return std::string("<Command Name=\"") + name + "\"><pValue>" + reg +
           "</pValue><CommandValue>1</CommandValue></Command>\n" + integer(reg.c_str(), at, 4, "RW");
}

std::string clock_nodes() {
    return "<Boolean Name=\"PtpEnable\"><pValue>PtpEnableReg</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>" +
           integer("PtpEnableReg", ptp_enable, 4, "RW") + command("PtpDataSetLatch", ptp_latch) +
           "<Enumeration Name=\"PtpStatus\"><EnumEntry Name=\"Disabled\"><Value>0</Value></EnumEntry>"
           "<EnumEntry Name=\"Listening\"><Value>1</Value></EnumEntry><EnumEntry Name=\"Slave\"><Value>2</Value>"
           "</EnumEntry><pValue>PtpStatusReg</pValue></Enumeration>\n" + integer("PtpStatusReg", ptp_status, 4, "RO") +
           integer("PtpOffsetFromMaster", ptp_offset, 8, "RO") + command("TimestampLatch", time_latch) +
           integer("TimestampLatchValue", latched_time, 8, "RO") + integer("ActionDeviceKey", action_device_key, 4, "RW") +
           integer("ActionGroupKey", action_group_key, 4, "RW") + integer("ActionGroupMask", action_group_mask, 4, "RW") +
           integer("TriggerSourceOfOurs", trigger_source, 4, "RW");
}

std::string description() {
    ArvFakeCamera* plain = arv_fake_camera_new("plain");
    size_t size = 0;
    std::string xml(arv_fake_camera_get_genicam_xml(plain, &size));
    const auto put = [&](const char* before, const char* text) {
        const size_t at = xml.find(before);
        if (at != std::string::npos) xml.insert(at, text);
    };
    put("<pFeature>PayloadSize", names);
    put("<Port Name=\"Device\"", nodes);
    put("<Port Name=\"Device\"", clock_nodes().c_str());
    // a source more, in a register of ours: libaravis' own stays on Software
    const std::string theirs = "<pValue>TriggerSourceRegister</pValue>";
    if (const size_t at = xml.find(theirs); at != std::string::npos)
        xml.replace(at, theirs.size(), "<EnumEntry Name=\"Action1\" NameSpace=\"Standard\"><Value>2</Value></EnumEntry>"
                                       "<pValue>TriggerSourceOfOurs</pValue>");
    g_object_unref(plain);
    return xml;
}

void show(ArvBuffer* buffer, void* data, guint32 exposure_us, guint32 gain, ArvPixelFormat format) {
    auto& pictures = *static_cast<Pictures*>(data);
    size_t unused = 0;
    auto* out = static_cast<uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, &unused)));
    const size_t width = size_t(arv_buffer_get_image_width(buffer)), height = size_t(arv_buffer_get_image_height(buffer));
    if (!out || format != ARV_PIXEL_FORMAT_MONO_8) return;
    const auto* head = reinterpret_cast<const std::atomic<uint64_t>*>(pictures.memory);
    const uint64_t number = head->load(std::memory_order_acquire);
    ++pictures.shown;
    if (const int64_t acted = pictures.acted_ns.exchange(0)) arv_buffer_set_timestamp(buffer, guint64(acted));
    (void)exposure_us, (void)gain;
    if (number == 0 || width > pictures.width || height > pictures.height) {
        for (size_t y = 0; y < height; ++y)
            for (size_t x = 0; x < width; ++x) out[y * width + x] = uint8_t(x + y + 4 * pictures.shown);
        return;
    }
    const uint8_t* picture = pictures.memory + head_bytes + (number & 1) * pictures.width * pictures.height;
    for (size_t y = 0; y < height; ++y) std::memcpy(out + y * width, picture + y * pictures.width, width);
}


class Clock {  // synchronised as by IEEE 1588, and what is done at a time of it
   public:
    Clock(ArvFakeCamera* camera, Pictures& pictures, unsigned number) : camera_(camera), pictures_(pictures) {
        offset_ns_ = int64_t(number * 7919 % 801) - 400;
        ear_ = socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC, htons(0x0800));  // libaravis has the port itself
        only_control(ear_);
    }

    void run() {
        for (;;) {
            pollfd wait{ear_, POLLIN, 0};
            if (poll(&wait, ear_ >= 0, 1) > 0) listen();
            keep();
        }
    }

   private:
    static int64_t now() { return int64_t(g_get_real_time()) * 1000; }

    uint32_t get(uint32_t at) const {
        guint32 value = 0;
        arv_fake_camera_read_register(camera_, at, &value);
        return value;
    }

    void put(uint32_t at, int64_t value) {
        uint8_t bytes[8];
        for (int i = 0; i < 8; ++i) bytes[i] = uint8_t(uint64_t(value) >> (56 - 8 * i));
        arv_fake_camera_write_memory(camera_, at, 8, bytes);
    }

    void keep() {
        const bool on = get(ptp_enable) == 1;
        since_ns_ = on ? (since_ns_ ? since_ns_ : now()) : 0;
        const bool slave = on && now() - since_ns_ > settling_ns;
        arv_fake_camera_write_register(camera_, ptp_status, slave ? 2 : on ? 1 : 0);
        put(ptp_offset, slave ? offset_ns_ : 0);
        if (get(ptp_latch) == 1) arv_fake_camera_write_register(camera_, ptp_latch, 0);
        if (get(time_latch) == 1) {
            put(latched_time, now() + (slave ? offset_ns_ : 0));
            arv_fake_camera_write_register(camera_, time_latch, 0);
        }
        if (due_ns_ && now() >= due_ns_) act();
        if (get(packet_size) & fire) send_test_packet();
        const uint32_t kept = get(ip_configuration) & 1 ? get(persistent_address) : 0;
        if (kept != kept_) say("keep", kept_ = kept);
    }

    static void say(const char* what, uint32_t address) {
        const in_addr in{htonl(address)};
        char text[INET_ADDRSTRLEN];
        std::printf("%s %s\n", what, inet_ntop(AF_INET, &in, text, sizeof text));
        std::fflush(stdout);
    }

    void send_test_packet() {
        const uint32_t wanted = get(packet_size);
        arv_fake_camera_write_register(camera_, packet_size, wanted & ~fire);
        const size_t bytes = wanted & 0xffff;
        const int out = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), whole = IP_PMTUDISC_PROBE;
        setsockopt(out, IPPROTO_IP, IP_MTU_DISCOVER, &whole, sizeof whole);
        sockaddr_in to{};
        to.sin_family = AF_INET, to.sin_port = htons(uint16_t(get(stream_port))), to.sin_addr.s_addr = htonl(get(stream_address));
        const std::string data(bytes > 28 ? bytes - 28 : 0, '\0');
        sendto(out, data.data(), data.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);  // too large: none
        close(out);
    }

    void act() {
        pictures_.acted_ns = due_ns_ + offset_ns_;
        due_ns_ = 0;
        arv_fake_camera_write_register(camera_, ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE, 1);
    }

    // Without it the images of all cameras fill the socket, and on a busy machine action commands are lost behind them.
    static void only_control(int ear) {
        sock_filter code[] = {
            BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 9),  BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, IPPROTO_UDP, 0, 4),
            BPF_STMT(BPF_LDX | BPF_B | BPF_MSH, 0), BPF_STMT(BPF_LD | BPF_H | BPF_IND, 2),
            BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 3956, 0, 1), BPF_STMT(BPF_RET | BPF_K, 0xffff),
            BPF_STMT(BPF_RET | BPF_K, 0),
        };
        const sock_fprog filter{sizeof code / sizeof code[0], code};
        setsockopt(ear, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter);
    }

    void listen() {
        uint8_t data[576];
        const ssize_t n = recv(ear_, data, sizeof data, MSG_DONTWAIT);
        if (n < 20 || data[9] != IPPROTO_UDP) return;
        const size_t head = size_t(data[0] & 15) * 4, udp = head + 8, body = udp + 8;
        const auto word = [&](size_t at) { return uint32_t(data[at]) << 24 | data[at + 1] << 16 | data[at + 2] << 8 | data[at + 3]; };
        if (size_t(n) < body + 12 || (data[head + 2] << 8 | data[head + 3]) != 3956 || data[udp] != 0x42) return;
        const int asked = data[udp + 2] << 8 | data[udp + 3];
        if (asked == 0x0004 && size_t(n) >= body + 56 && get(0x0a00) == 0) {  // FORCEIP, heeded while nobody has control
            const uint32_t high = word(body) & 0xffff, low = word(body + 4);
            if (high == (get(0x08) & 0xffff) && low == get(0x0c)) say("address", word(body + 20));
        }
        if (asked != 0x0100 || get(trigger_source) != 2) return;
        if (word(body) != get(action_device_key) || word(body + 4) != get(action_group_key)) return;
        if ((word(body + 8) & get(action_group_mask)) == 0) return;
        const bool scheduled = data[udp + 1] & 0x80 && size_t(n) >= body + 20;
        due_ns_ = scheduled ? int64_t(uint64_t(word(body + 12)) << 32 | word(body + 16)) : now();
    }

    static constexpr int64_t settling_ns = 300000000;
    ArvFakeCamera* camera_;
    Pictures& pictures_;
    int ear_ = -1;
    int64_t offset_ns_ = 0, since_ns_ = 0, due_ns_ = 0;
    uint32_t kept_ = 0;
};

}  // namespace

int main(int count, char** words) {
    if (count != 8) return std::fprintf(stderr, "seven words are needed\n"), 2;
    Pictures pictures;
    pictures.width = size_t(std::atol(words[3])), pictures.height = size_t(std::atol(words[4]));
    const size_t bytes = head_bytes + 2 * pictures.width * pictures.height;
    void* mapped = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, std::atoi(words[7]), 0);
    if (mapped == MAP_FAILED) return std::perror("the pictures cannot be mapped"), 2;
    pictures.memory = static_cast<const uint8_t*>(mapped);

    const std::string xml = description();
    char file[] = "/tmp/spherecal-gige-XXXXXX";
    const int out = mkstemp(file);
    if (out < 0 || write(out, xml.data(), xml.size()) != ssize_t(xml.size())) return std::perror(file), 2;
    close(out);
    ArvGvFakeCamera* server = arv_gv_fake_camera_new_full(words[1], words[2], file);
    unlink(file);
    if (!arv_gv_fake_camera_is_running(server)) return std::fprintf(stderr, "no camera on %s\n", words[1]), 2;
    ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(server);

    uint8_t mac[8] = {};
    unsigned part[6] = {};
    if (std::sscanf(words[5], "%x:%x:%x:%x:%x:%x", part, part + 1, part + 2, part + 3, part + 4, part + 5) != 6) return 2;
    for (int i = 0; i < 6; ++i) mac[2 + i] = uint8_t(part[i]);
    arv_fake_camera_write_memory(camera, 0x08, 8, mac);
    in_addr mask{};
    inet_pton(AF_INET, words[6], &mask);
    arv_fake_camera_write_memory(camera, 0x34, 4, &mask);
    char text[32] = "SphereCal";
    arv_fake_camera_write_memory(camera, 0x48, 32, text);
    std::snprintf(text, sizeof text, "%s", "Simulated GigE");
    arv_fake_camera_write_memory(camera, 0x68, 32, text);
    const auto width = guint32(pictures.width), height = guint32(pictures.height);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, width);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, height);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_WIDTH, width);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_HEIGHT, height);
    arv_fake_camera_set_fill_pattern(camera, show, &pictures);
    arv_fake_camera_write_register(camera, ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE, 1);
    arv_fake_camera_write_register(camera, trigger_source, 1);
    auto* clock = new Clock(camera, pictures, part[5]);
    std::thread([clock] { clock->run(); }).detach();

    std::puts("ready");
    std::fflush(stdout);
    char byte;
    while (read(STDIN_FILENO, &byte, 1) > 0) {
    }
    return 0;  // what the camera holds goes with the process
}
