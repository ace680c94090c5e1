// The few messages of GigE Vision's control protocol that are sent beside libaravis: search, one register, action.
//
// libaravis searches all networks at once, keeps no subnet mask and no holder of a camera, and waits three seconds for a
// lost one. These are plain datagrams to port 3956; a register is read from a socket of our own, which every camera
// allows whoever controls it.
#pragma once

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

namespace gvcp {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr uint16_t port = 3956;
enum : uint16_t { discovery_command = 0x0002, discovery_answer = 0x0003, read_command = 0x0080, read_answer = 0x0081 };
constexpr uint16_t action_command = 0x0100;
constexpr uint8_t answer_wanted = 0x01, broadcast_answer_allowed = 0x10, has_time = 0x80;
constexpr size_t header_bytes = 8, discovery_bytes = 248;
constexpr uint32_t control_register = 0x0A00;  // who has control: bit 0 exclusive, bit 1 control

using Bytes = std::vector<uint8_t>;

inline void put16(Bytes& out, uint16_t v) { out.push_back(uint8_t(v >> 8)), out.push_back(uint8_t(v)); }
inline void put32(Bytes& out, uint32_t v) { put16(out, uint16_t(v >> 16)), put16(out, uint16_t(v)); }
inline uint16_t get16(const uint8_t* p) { return uint16_t(p[0] << 8 | p[1]); }
inline uint32_t get32(const uint8_t* p) { return uint32_t(get16(p)) << 16 | get16(p + 2); }

inline std::string address_text(uint32_t address) {  // host byte order
    char text[INET_ADDRSTRLEN];
    const in_addr raw{htonl(address)};
    return inet_ntop(AF_INET, &raw, text, sizeof text);
}

inline Bytes command(uint16_t kind, uint8_t flags, uint16_t id, const Bytes& payload) {
    Bytes out{0x42, flags};
    put16(out, kind), put16(out, uint16_t(payload.size())), put16(out, id);
    out.insert(out.end(), payload.begin(), payload.end());
    return out;
}

inline uint16_t next_id() {
    static std::atomic<uint16_t> last{0};
    const uint16_t id = ++last;
    return id ? id : ++last;  // 0 is not allowed
}

class Socket {  // a datagram socket of any free port
   public:
    Socket() : file_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
        const int on = 1;
        setsockopt(file_, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
    }
    ~Socket() {
        if (file_ >= 0) ::close(file_);
    }
    Socket(const Socket&) = delete;

    // `link`: the number of the interface to leave by, 0 for the routing table's; false where the system refuses.
    bool send(uint32_t to, const Bytes& message, unsigned link = 0) const {
        sockaddr_in there = at(to);
        iovec data{const_cast<uint8_t*>(message.data()), message.size()};
        alignas(cmsghdr) char control[CMSG_SPACE(sizeof(in_pktinfo))] = {};
        msghdr head{};
        head.msg_name = &there, head.msg_namelen = sizeof there;
        head.msg_iov = &data, head.msg_iovlen = 1;
        if (link) {
            head.msg_control = control, head.msg_controllen = sizeof control;
            cmsghdr* about = CMSG_FIRSTHDR(&head);
            about->cmsg_level = IPPROTO_IP, about->cmsg_type = IP_PKTINFO;
            about->cmsg_len = CMSG_LEN(sizeof(in_pktinfo));
            in_pktinfo leave{};
            leave.ipi_ifindex = int(link);
            std::memcpy(CMSG_DATA(about), &leave, sizeof leave);
        }
        return file_ >= 0 && sendmsg(file_, &head, 0) == ssize_t(message.size());
    }

    // The next datagram from the control port of a camera; empty at the deadline.
    Bytes receive(Clock::time_point deadline, uint32_t* from = nullptr) const {
        for (;;) {
            const auto left = std::chrono::duration_cast<milliseconds>(deadline - Clock::now()).count();
            pollfd wait{file_, POLLIN, 0};
            if (file_ < 0 || left < 0 || poll(&wait, 1, int(left)) <= 0) return {};
            Bytes got(1024);
            sockaddr_in sender{};
            socklen_t size = sizeof sender;
            const ssize_t n = recvfrom(file_, got.data(), got.size(), 0, reinterpret_cast<sockaddr*>(&sender), &size);
            if (n < 0) {
                if (errno == ECONNREFUSED || errno == EAGAIN || errno == EINTR) continue;
                return {};
            }
            if (ntohs(sender.sin_port) != port) continue;
            got.resize(size_t(n));
            if (from) *from = ntohl(sender.sin_addr.s_addr);
            return got;
        }
    }

    static sockaddr_in at(uint32_t address) {
        sockaddr_in there{};
        there.sin_family = AF_INET, there.sin_port = htons(port), there.sin_addr.s_addr = htonl(address);
        return there;
    }

   private:
    int file_;
};

struct Link {  // a network interface with an IPv4 address
    std::string name;
    unsigned index = 0;
    uint32_t address = 0, mask = 0;
};

inline std::vector<Link> links() {
    std::vector<Link> found;
    ifaddrs* all = nullptr;
    if (getifaddrs(&all) != 0) return found;
    for (const ifaddrs* one = all; one; one = one->ifa_next) {
        if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET || !one->ifa_netmask) continue;
        if (!(one->ifa_flags & IFF_UP) || one->ifa_flags & (IFF_LOOPBACK | IFF_POINTOPOINT)) continue;
        const auto ip = [](const sockaddr* a) { return ntohl(reinterpret_cast<const sockaddr_in*>(a)->sin_addr.s_addr); };
        found.push_back({one->ifa_name, if_nametoindex(one->ifa_name), ip(one->ifa_addr), ip(one->ifa_netmask)});
    }
    freeifaddrs(all);
    return found;
}

// The address of this machine from which a camera is reached; nothing where no route leads there.
inline std::optional<uint32_t> local_address(uint32_t camera) {
    const int file = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const sockaddr_in there = Socket::at(camera);
    sockaddr_in here{};
    socklen_t size = sizeof here;
    const bool found = file >= 0 && connect(file, reinterpret_cast<const sockaddr*>(&there), sizeof there) == 0 &&
                       getsockname(file, reinterpret_cast<sockaddr*>(&here), &size) == 0;
    if (file >= 0) ::close(file);
    return found ? std::optional<uint32_t>(ntohl(here.sin_addr.s_addr)) : std::nullopt;
}

struct Found {  // what a camera says of itself
    uint32_t address = 0, mask = 0, gateway = 0;
    std::string mac, vendor, model, version, serial, user_name;

    // One camera by what it says of itself. Cloned ones and stock fakes are equal in all, and differ in their address.
    bool alike(const Found& o) const {
        return mac == o.mac && serial == o.serial && model == o.model && vendor == o.vendor;
    }
    bool same(const Found& o) const { return alike(o) && address == o.address; }
};

inline std::optional<Found> understood(const Bytes& answer) {
    if (answer.size() < header_bytes + discovery_bytes || get16(&answer[0]) != 0 || get16(&answer[2]) != discovery_answer)
        return std::nullopt;
    const uint8_t* data = &answer[header_bytes];
    const auto text = [&](size_t from, size_t size) {
        const char* begin = reinterpret_cast<const char*>(data + from);
        std::string plain(begin, strnlen(begin, size));
        for (char& c : plain)
            if (static_cast<unsigned char>(c) < 32) c = '?';
        return plain;
    };
    Found found;
    char mac[18];
    std::snprintf(mac, sizeof mac, "%02x:%02x:%02x:%02x:%02x:%02x", data[10], data[11], data[12], data[13], data[14],
                  data[15]);
    found.mac = mac;
    found.address = get32(data + 0x24), found.mask = get32(data + 0x34), found.gateway = get32(data + 0x44);
    found.vendor = text(0x48, 32), found.model = text(0x68, 32), found.version = text(0x88, 32);
    found.serial = text(0xD8, 16), found.user_name = text(0xE8, 16);
    return found;
}

// The cameras that answer to a search: on a link to everybody, or each of these addresses. Ends at the timeout, earlier
// when somebody has answered and then nobody for a while.
inline std::vector<Found> search(unsigned link, const std::vector<uint32_t>& addresses, milliseconds timeout) {
    constexpr milliseconds quiet{250}, again{150};
    const Socket socket;
    const uint8_t flags = answer_wanted | (link ? broadcast_answer_allowed : 0);
    const auto ask = [&] {
        const Bytes message = command(discovery_command, flags, next_id(), {});
        if (link) socket.send(INADDR_BROADCAST, message, link);
        for (const uint32_t address : addresses) socket.send(address, message);
    };
    std::vector<Found> found;
    const auto begun = Clock::now(), end = begun + timeout;
    auto last = begun;
    ask();
    bool asked_again = false;
    for (;;) {
        auto until = end;
        if (!found.empty()) until = std::min(until, std::max(last + quiet, begun + again + quiet));
        const bool first = !asked_again && begun + again < until;
        uint32_t from = 0;
        const Bytes answer = socket.receive(first ? begun + again : until, &from);
        if (answer.empty() && first) {  // one search may be lost
            ask();
            asked_again = true;
            continue;
        }
        if (answer.empty()) return found;
        std::optional<Found> one = understood(answer);
        if (!one) continue;
        if (!link || one->address == 0) one->address = from;  // as it was reached
        bool known = false;
        for (const Found& other : found) known |= other.same(*one);
        if (!known) found.push_back(*one), last = Clock::now();
    }
}

// A register of a camera, asked so many times; nothing where it does not answer.
inline std::optional<uint32_t> read_register(uint32_t camera, uint32_t address, milliseconds each, int times) {
    const Socket socket;
    Bytes payload;
    put32(payload, address);
    for (int i = 0; i < times; ++i) {
        const uint16_t id = next_id();
        socket.send(camera, command(read_command, answer_wanted, id, payload));
        const auto deadline = Clock::now() + each;
        for (;;) {
            const Bytes answer = socket.receive(deadline);
            if (answer.empty()) break;
            if (answer.size() >= 12 && get16(&answer[2]) == read_answer && get16(&answer[6]) == id && get16(&answer[0]) == 0)
                return get32(&answer[8]);
        }
    }
    return std::nullopt;
}

}  // namespace gvcp
