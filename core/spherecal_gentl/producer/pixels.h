// Pixel formats, the built-in picture, and how a row of grey values becomes bytes on the wire.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace pixels {

enum Format : uint32_t {  // the numbers of the GenICam pixel format naming convention
    mono8 = 0x01080001,
    bayer_rg8 = 0x01080009,
    mono10 = 0x01100003,
    mono10p = 0x010A0046,
    mono12 = 0x01100005,
    mono12p = 0x010C0047,
    mono12packed = 0x010C0006,
};

inline bool known(uint32_t format) {
    return format == mono8 || format == bayer_rg8 || format == mono10 || format == mono10p || format == mono12 ||
           format == mono12p || format == mono12packed;
}

inline uint32_t bits_on_wire(uint32_t format) { return format >> 16 & 0xFF; }

inline uint32_t significant_bits(uint32_t format) {
    if (format == mono8 || format == bayer_rg8) return 8;
    return format == mono10 || format == mono10p ? 10 : 12;
}

inline size_t row_bytes(uint32_t format, uint32_t width) { return (size_t(width) * bits_on_wire(format) + 7) / 8; }

// Grey values of the scene to grey values of the format: shifted to full scale, then times exposure and gain.
class Tone {
   public:
    void prepare(uint32_t source_bits, uint32_t format, double factor) {
        if (source_bits == source_bits_ && format == format_ && factor == factor_) return;
        source_bits_ = source_bits, format_ = format, factor_ = factor;
        const uint32_t down = 16 - significant_bits(format);
        table_.resize(size_t(1) << source_bits);
        for (size_t v = 0; v < table_.size(); ++v) {
            const double lit = std::floor(double(v << (16 - source_bits)) * factor + 0.5);
            table_[v] = uint16_t(uint32_t(std::min(lit, 65535.0)) >> down);
        }
        plain_copy_ = source_bits == 8 && significant_bits(format) == 8 && factor == 1.0;
    }

    template <class Grey>
    void write_row(const Grey* grey, uint32_t width, uint8_t* out) const {
        if (plain_copy_ && sizeof(Grey) == 1) {
            std::memcpy(out, grey, width);
            return;
        }
        const uint32_t mask = uint32_t(table_.size() - 1);
        const auto value = [&](uint32_t i) { return uint32_t(table_[grey[i] & mask]); };
        switch (format_) {
            case mono10:
            case mono12:
                for (uint32_t i = 0; i < width; ++i, out += 2) {
                    const uint32_t v = value(i);
                    out[0] = uint8_t(v), out[1] = uint8_t(v >> 8);
                }
                break;
            case mono12p:  // lowest bits first, two pixels in three bytes
                for (uint32_t i = 0; i + 1 < width; i += 2, out += 3) {
                    const uint32_t v = value(i) | value(i + 1) << 12;
                    out[0] = uint8_t(v), out[1] = uint8_t(v >> 8), out[2] = uint8_t(v >> 16);
                }
                break;
            case mono12packed:  // GigE Vision's older order: the low halves share the middle byte
                for (uint32_t i = 0; i + 1 < width; i += 2, out += 3) {
                    const uint32_t a = value(i), b = value(i + 1);
                    out[0] = uint8_t(a >> 4), out[1] = uint8_t((a & 15) | (b & 15) << 4), out[2] = uint8_t(b >> 4);
                }
                break;
            case mono10p:  // lowest bits first, four pixels in five bytes
                for (uint32_t i = 0; i + 3 < width; i += 4, out += 5) {
                    uint64_t v = 0;
                    for (uint32_t k = 0; k < 4; ++k) v |= uint64_t(value(i + k)) << (10 * k);
                    for (uint32_t k = 0; k < 5; ++k) out[k] = uint8_t(v >> (8 * k));
                }
                break;
            default:
                for (uint32_t i = 0; i < width; ++i) out[i] = uint8_t(value(i));
        }
    }

   private:
    uint32_t source_bits_ = 0, format_ = 0;
    double factor_ = 0;
    bool plain_copy_ = false;
    std::vector<uint16_t> table_;
};

// The picture of a camera without images: a diagonal ramp (x + y + 4 frame) mod 256 that moves with every frame. In its
// upper left corner the frame number, once as 32 bits (8 x 8 px each, lowest first, white is 1), once in digits.
class Pattern {
   public:
    const uint8_t* row(uint32_t y, uint32_t width, uint64_t frame) {
        if (row_.size() < width) row_.resize(width);
        for (uint32_t x = 0; x < width; ++x) row_[x] = uint8_t(x + y + 4 * frame);
        if (y < 8)
            for (uint32_t x = 0; x < std::min(width, 256u); ++x) row_[x] = frame >> (x / 8) & 1 ? 255 : 0;
        else if (y >= digits_top && y < digits_top + 5 * digit_scale)
            digits_row((y - digits_top) / digit_scale, width, frame);
        return row_.data();
    }

   private:
    static constexpr uint32_t digits_top = 16, digit_scale = 8, digit_count = 8;

    void digits_row(uint32_t line, uint32_t width, uint64_t frame) {
        // three pixels by five, the first line in the highest bits
        static const uint16_t shapes[10] = {0x7B6F, 0x2C97, 0x73E7, 0x73CF, 0x5BC9,
                                            0x79CF, 0x79EF, 0x7249, 0x7BEF, 0x7BCF};
        uint64_t rest = frame;
        for (uint32_t place = digit_count; place-- > 0; rest /= 10) {
            const uint32_t bits = shapes[rest % 10] >> (3 * (4 - line)) & 7;
            for (uint32_t column = 0; column < 4; ++column) {
                const uint32_t left = (place * 4 + column) * digit_scale;
                if (left + digit_scale > width) continue;
                std::memset(&row_[left], column < 3 && bits >> (2 - column) & 1 ? 255 : 0, digit_scale);
            }
        }
    }

    std::vector<uint8_t> row_;
};

}  // namespace pixels
