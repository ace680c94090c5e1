// How a simulated camera differs from the usual one, for tests: SPHERECAL_GENTL_ODD holds words like `ids=0 stamps=second`.
//
//   description=FILE  its GenICam description: an .xml or .zip file, or a whole URL `file:///...`. Registers that the
//                     simulated camera does not have are plain memory then, so that real cameras' files can be opened.
//   ids=N             every image has this number
//   stamps=none|second  no time stamps, or only the nanoseconds of the second
//   waiting=0         the stream says that no image waits
//   buffers=N         the least number of buffers
//   serial=TEXT       every camera's serial number (may be empty), `model=TEXT` its model
//   format=N          the number of the pixel format that images name
//   parts=N           every buffer has two parts: one of the pixel format N, then the image
//   texts=HEX         behind every text of an error and in the maker's name: these bytes, which may be no UTF-8
//   big=1             pixels of two bytes have the high one first
#pragma once

#include <cstdlib>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string>

namespace odd {

inline std::optional<std::string> word(const std::string& name) {
    const char* all = std::getenv("SPHERECAL_GENTL_ODD");
    std::istringstream words(all ? all : "");
    for (std::string one; words >> one;)
        if (one.compare(0, name.size() + 1, name + "=") == 0) return one.substr(name.size() + 1);
    return std::nullopt;
}

inline uint64_t number(const std::string& name, uint64_t usual) {
    const std::optional<std::string> found = word(name);
    return found ? std::strtoull(found->c_str(), nullptr, 0) : usual;
}

inline bool is(const std::string& name, const std::string& value) { return word(name) == value; }

inline std::string bytes(const std::string& name) {
    const std::string hex = word(name).value_or("");
    std::string found;
    for (size_t i = 0; i + 1 < hex.size(); i += 2) found += char(std::strtoul(hex.substr(i, 2).c_str(), nullptr, 16));
    return found;
}

struct Description {
    std::string text, name, url;  // url: where it is not in the camera
};

inline std::optional<Description> description() {
    const std::optional<std::string> file = word("description");
    if (!file) return std::nullopt;
    if (file->compare(0, 5, "file:") == 0) return Description{"", "", *file};
    std::ifstream in(*file, std::ios::binary);
    std::ostringstream text;
    text << in.rdbuf();
    return Description{text.str(), file->substr(file->find_last_of('/') + 1), ""};
}

class Memory {  // bytes of registers that nobody else has
   public:
    void read(uint64_t at, uint8_t* out, size_t size) const {
        for (size_t i = 0; i < size; ++i) {
            const auto found = bytes_.find(at + i);
            out[i] = found == bytes_.end() ? 0 : found->second;
        }
    }
    void write(uint64_t at, const uint8_t* data, size_t size) {
        for (size_t i = 0; i < size; ++i) bytes_[at + i] = data[i];
    }

   private:
    std::map<uint64_t, uint8_t> bytes_;
};

}  // namespace odd
