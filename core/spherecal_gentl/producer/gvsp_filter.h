// A filter in the kernel for the socket on which libaravis receives a camera's images.
//
// libaravis 0.8 trusts what it receives. A frame that begins with a trailer or a part gets as many packets as that says,
// and a pixel packet beyond the buffer is then copied with a negative size; a packet shorter than its head too; a frame
// that begins with a kind of packet that it does not know is a null pointer. One such packet ends the program, from
// any computer that writes the camera's address into it. What passes here: packets of the camera with a whole head, of
// the kinds leader, trailer and payload, whose place is in the buffer, and leaders of payloads that are not in parts.
#pragma once

#include <dirent.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace gvsp {

constexpr uint32_t udp = 8, head = 8, long_head = 20, ip = 20;  // bytes of the heads
constexpr uint32_t leader = 1, trailer = 2, payload = 3, long_ids = 0x80, error = 0x8000;
constexpr uint32_t image = 1, image_with_chunks = 5, last_whole_payload = 8, chunks = 0x4000, image_leader = 36;

class Program {
   public:
    void load(uint16_t size, uint32_t at) { code_.push_back(BPF_STMT(uint16_t(BPF_LD | size | BPF_ABS), at)); }
    void mask(uint32_t bits) { code_.push_back(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, bits)); }
    void keep() { code_.push_back(BPF_STMT(BPF_MISC | BPF_TAX, 0)); }
    void kept() { code_.push_back(BPF_STMT(BPF_MISC | BPF_TXA, 0)); }
    void accept() { code_.push_back(BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFF)); }
    void drop() { code_.push_back(BPF_STMT(BPF_RET | BPF_K, 0)); }
    void want(uint32_t value) { code_.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 1, 0)), drop(); }
    void at_most(uint32_t value) { code_.push_back(BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, value, 0, 1)), drop(); }
    void accept_if(uint32_t value) { code_.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1)), accept(); }
    void accept_if_any(uint32_t bits) { code_.push_back(BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, bits, 0, 1)), accept(); }
    void then(const Program& next) { code_.insert(code_.end(), next.code_.begin(), next.code_.end()); }
    void skip_unless(uint16_t test, uint32_t value, const Program& next) {
        code_.push_back(BPF_JUMP(uint16_t(BPF_JMP | test | BPF_K), value, 0, uint8_t(next.code_.size())));
        then(next);
    }
    bool attach(int socket) {
        sock_fprog program{static_cast<unsigned short>(code_.size()), code_.data()};
        return setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0;
    }

   private:
    std::vector<sock_filter> code_;
};

// Packets with heads of this size, of which the last of `blocks` with pixels still has its place in the buffer.
inline Program of_head(uint32_t head_bytes, uint32_t number_at, uint32_t number_bits, uint32_t blocks) {
    Program pixels, all;
    pixels.kept(), pixels.at_most(blocks), pixels.accept();
    all.load(BPF_W, number_at), all.mask(number_bits), all.keep();  // too short: dropped by the kernel
    all.at_most(blocks + 1);
    all.load(BPF_B, udp + 4), all.mask(~long_ids & 0xFF);
    all.skip_unless(BPF_JEQ, payload, pixels);
    all.accept_if(trailer), all.want(leader);
    all.load(BPF_H, udp), all.accept_if_any(error);
    Program whole;
    whole.load(BPF_B, udp + head_bytes + image_leader - 1), whole.accept();
    all.load(BPF_H, udp + head_bytes + 2), all.mask(~chunks & 0xFFFF), all.at_most(last_whole_payload);
    all.skip_unless(BPF_JEQ, image, whole);
    all.skip_unless(BPF_JEQ, image_with_chunks, whole);
    all.accept();
    return all;
}

inline Program filter(uint32_t camera, uint32_t packet_size, size_t buffer_size) {
    const auto blocks = [&](uint32_t head_bytes) {
        const size_t block = std::max<size_t>(packet_size, ip + udp + head_bytes + 1) - ip - udp - head_bytes;
        return uint32_t(std::min<size_t>((buffer_size + block - 1) / block, 0xFFFFF0));
    };
    Program all;
    all.load(BPF_W, uint32_t(SKF_NET_OFF) + 12), all.want(camera);
    all.load(BPF_B, udp + 4);
    all.skip_unless(BPF_JSET, long_ids, of_head(long_head, udp + 16, 0xFFFFFFFF, blocks(long_head)));
    all.then(of_head(head, udp + 4, 0xFFFFFF, blocks(head)));
    return all;
}

// This process's socket for datagrams on a port, which libaravis does not give out; -1 where there is none.
inline int socket_on(uint16_t port) {
    int found = -1;
    DIR* files = opendir("/proc/self/fd");
    if (!files) return -1;
    while (const dirent* file = readdir(files)) {
        const int number = std::atoi(file->d_name);
        int kind = 0;
        socklen_t kind_size = sizeof kind;
        sockaddr_in here{};
        socklen_t here_size = sizeof here;
        if (getsockopt(number, SOL_SOCKET, SO_TYPE, &kind, &kind_size) != 0 || kind != SOCK_DGRAM) continue;
        if (getsockname(number, reinterpret_cast<sockaddr*>(&here), &here_size) != 0) continue;
        if (here.sin_family == AF_INET && ntohs(here.sin_port) == port) found = number;
    }
    closedir(files);
    return found;
}

}  // namespace gvsp
