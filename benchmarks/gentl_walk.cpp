// Walks a GenTL producer by its exported functions, for the sanitizers: every interface, every camera, streams started
// and stopped, registers read by a second thread meanwhile, wrong handles, buffers flushed while the stream runs.
//
//   gentl_walk CYCLES [FRAMES]
//
// Built together with the producer's source. Prints frames and incomplete frames as they come; camera errors are counted, not fatal.

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "gentl_abi.h"

namespace gentl {
extern "C" {
Error GCInitLib();
Error GCCloseLib();
Error GCGetLastError(Error*, char*, size_t*);
Error GCReadPort(Handle, uint64_t, void*, size_t*);
Error GCGetPortURLInfo(Handle, uint32_t, int32_t, int32_t*, void*, size_t*);
Error GCRegisterEvent(Handle, int32_t, Handle*);
Error GCUnregisterEvent(Handle, int32_t);
Error EventGetData(Handle, void*, size_t*, uint64_t);
Error TLOpen(Handle*);
Error TLClose(Handle);
Error TLGetNumInterfaces(Handle, uint32_t*);
Error TLGetInterfaceID(Handle, uint32_t, char*, size_t*);
Error TLOpenInterface(Handle, const char*, Handle*);
Error TLUpdateInterfaceList(Handle, uint8_t*, uint64_t);
Error IFClose(Handle);
Error IFUpdateDeviceList(Handle, uint8_t*, uint64_t);
Error IFGetNumDevices(Handle, uint32_t*);
Error IFGetDeviceID(Handle, uint32_t, char*, size_t*);
Error IFGetDeviceInfo(Handle, const char*, int32_t, int32_t*, void*, size_t*);
Error IFOpenDevice(Handle, const char*, int32_t, Handle*);
Error DevClose(Handle);
Error DevGetPort(Handle, Handle*);
Error DevGetDataStreamID(Handle, uint32_t, char*, size_t*);
Error DevOpenDataStream(Handle, const char*, Handle*);
Error DSClose(Handle);
Error DSGetInfo(Handle, int32_t, int32_t*, void*, size_t*);
Error DSAllocAndAnnounceBuffer(Handle, size_t, void*, Handle*);
Error DSRevokeBuffer(Handle, Handle, void**, void**);
Error DSQueueBuffer(Handle, Handle);
Error DSFlushQueue(Handle, int32_t);
Error DSGetBufferInfo(Handle, Handle, int32_t, int32_t*, void*, size_t*);
Error DSStartAcquisition(Handle, int32_t, uint64_t);
Error DSStopAcquisition(Handle, int32_t);
Error GCWritePort(Handle, uint64_t, const void*, size_t*);
}
}  // namespace gentl

namespace {

using namespace gentl;
std::atomic<long> frames{0}, incomplete{0}, errors{0};

void say() {
    std::printf("frames %ld incomplete %ld errors %ld\n", frames.load(), incomplete.load(), errors.load());
    std::fflush(stdout);
}

bool fine(Error code) {
    if (code != success) ++errors;
    return code == success;
}

void stream_once(Handle device, Handle port, Handle stream, int wanted) {
    size_t payload = 0, size = sizeof payload;
    int32_t type = 0;
    if (!fine(DSGetInfo(stream, stream_info::payload_size, &type, &payload, &size)) || !payload) return;
    std::vector<Handle> buffers(5);
    for (Handle& buffer : buffers) {
        fine(DSAllocAndAnnounceBuffer(stream, payload, nullptr, &buffer));
        fine(DSQueueBuffer(stream, buffer));
    }
    Handle event = nullptr;
    fine(GCRegisterEvent(stream, event_new_buffer, &event));
    if (fine(DSStartAcquisition(stream, 0, infinite))) {
        const uint8_t on[4] = {0, 0, 0, 1}, off[4] = {0, 0, 0, 0};  // the fake camera's own register
        size_t four = 4;
        GCWritePort(port, 0x124, on, &four);
        std::atomic<bool> done{false};
        std::thread reader([&] {
            while (!done) {
                uint8_t bytes[16];
                size_t n = sizeof bytes;
                fine(GCReadPort(port, 0xD8, bytes, &n));
            }
        });
        for (int i = 0; i < wanted; ++i) {
            NewBuffer got{};
            size_t n = sizeof got;
            if (!fine(EventGetData(event, &got, &n, 1000))) continue;
            uint8_t flag = 0;
            size_t one = 1;
            fine(DSGetBufferInfo(stream, got.buffer, buffer_info::is_incomplete, &type, &flag, &one));
            ++frames, incomplete += flag;
            if (frames % 5 == 0) say();
            fine(DSQueueBuffer(stream, got.buffer));
            if (i == wanted / 2) fine(DSFlushQueue(stream, flush::discard_all)), fine(DSFlushQueue(stream, flush::unqueued_to_input));
        }
        done = true;
        reader.join();
        GCWritePort(port, 0x124, off, &four);
        fine(DSStopAcquisition(stream, 0));
    }
    fine(DSFlushQueue(stream, flush::discard_all));
    fine(GCUnregisterEvent(stream, event_new_buffer));
    for (const Handle buffer : buffers) fine(DSRevokeBuffer(stream, buffer, nullptr, nullptr));
    (void)device;
}

void walk_camera(Handle link, const std::string& id, int wanted) {
    char text[256];
    for (int32_t what = 0; what < 10; ++what) {
        size_t size = sizeof text;
        int32_t type = 0;
        IFGetDeviceInfo(link, id.c_str(), what, &type, text, &size);
    }
    Handle device = nullptr, port = nullptr, stream = nullptr;
    if (!fine(IFOpenDevice(link, id.c_str(), access::exclusive, &device))) return;
    fine(DevGetPort(device, &port));
    std::vector<char> xml(1 << 16);
    size_t size = xml.size();
    fine(GCReadPort(port, 0x7F0000000000ull, xml.data(), &size));
    size = sizeof text;
    fine(DevGetDataStreamID(device, 0, text, &size));
    if (fine(DevOpenDataStream(device, text, &stream))) {
        stream_once(device, port, stream, wanted);
        stream_once(device, port, stream, 1);
        size = 64;
        fine(GCReadPort(stream, 0, text, &size));
        fine(DSClose(stream));
    }
    size = 4;
    if (GCReadPort(stream, 0, text, &size) != invalid_handle) ++errors;  // a handle that was taken back
    fine(DevClose(device));
}

void walk(int wanted) {
    Handle system = nullptr;
    if (!fine(TLOpen(&system))) return;
    uint8_t changed = 0;
    fine(TLUpdateInterfaceList(system, &changed, 100));
    uint32_t links = 0;
    fine(TLGetNumInterfaces(system, &links));
    for (uint32_t l = 0; l < links; ++l) {
        char name[256];
        size_t size = sizeof name;
        Handle link = nullptr;
        fine(TLGetInterfaceID(system, l, name, &size));
        if (!fine(TLOpenInterface(system, name, &link))) continue;
        fine(IFUpdateDeviceList(link, &changed, 500));
        uint32_t count = 0;
        fine(IFGetNumDevices(link, &count));
        std::vector<std::thread> cameras;
        for (uint32_t i = 0; i < count; ++i) {
            size = sizeof name;
            if (fine(IFGetDeviceID(link, i, name, &size))) cameras.emplace_back(walk_camera, link, std::string(name), wanted);
        }
        for (std::thread& camera : cameras) camera.join();
        fine(IFClose(link));
    }
    fine(TLClose(system));
}

}  // namespace

int main(int count, char** words) {
    const int cycles = count > 1 ? std::atoi(words[1]) : 1, wanted = count > 2 ? std::atoi(words[2]) : 10;
    fine(GCInitLib());
    for (int i = 0; i < cycles; ++i) {
        walk(wanted);
        say();
    }
    fine(GCCloseLib());
    return 0;
}
