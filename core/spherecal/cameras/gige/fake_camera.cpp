// A GigE Vision camera in this machine: libaravis' fake camera, with a serial number and a sensor size of its own, and
// with pictures that another program puts into shared memory.
//
//   fake_camera INTERFACE SERIAL WIDTH HEIGHT MAC MASK PICTURES_FD
//
// PICTURES_FD is an open file of: 64 bytes of head (the first 8: how many pictures were put there so far), then two
// pictures of WIDTH x HEIGHT bytes; number n is in place n mod 2. Without a picture the fake camera shows its ramp.
// Says "ready" when it answers, and ends with its standard input.

#include <arpa/inet.h>
#include <arv.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

constexpr size_t head_bytes = 64;

struct Pictures {
    const uint8_t* memory = nullptr;
    size_t width = 0, height = 0;
    uint32_t shown = 0;
};

// The features that libaravis' description leaves out and every real camera has.
constexpr const char* names =
    "<pFeature>DeviceSerialNumber</pFeature><pFeature>DeviceUserID</pFeature><pFeature>GevSCPSPacketSize</pFeature>"
    "<pFeature>GevSCPD</pFeature><pFeature>GevTimestampTickFrequency</pFeature><pFeature>TriggerMode</pFeature>"
    "<pFeature>TriggerSource</pFeature><pFeature>AcquisitionFrameRate</pFeature>";
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
    (void)exposure_us, (void)gain;
    if (number == 0 || width > pictures.width || height > pictures.height) {
        for (size_t y = 0; y < height; ++y)
            for (size_t x = 0; x < width; ++x) out[y * width + x] = uint8_t(x + y + 4 * pictures.shown);
        return;
    }
    const uint8_t* picture = pictures.memory + head_bytes + (number & 1) * pictures.width * pictures.height;
    for (size_t y = 0; y < height; ++y) std::memcpy(out + y * width, picture + y * pictures.width, width);
}

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

    std::puts("ready");
    std::fflush(stdout);
    char byte;
    while (read(STDIN_FILENO, &byte, 1) > 0) {
    }
    return 0;  // what the camera holds goes with the process
}
