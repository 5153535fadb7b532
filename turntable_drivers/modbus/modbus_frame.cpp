#include "turntable_drivers/modbus/modbus_frame.h"

#include <bit>
#include <cassert>
#include <cmath>

#include "imu_io/base/crc.h"

namespace turncal {
namespace {

std::uint16_t bytes_swapped(std::uint16_t word) { return std::uint16_t(word << 8 | word >> 8); }

struct Span {
  double min, max;
};
constexpr Span spans[] = {  // in the order of WordType
    {0.0, 65535.0},    {-32768.0, 32767.0}, {0.0, 4294967295.0}, {-2147483648.0, 2147483647.0},
    {-3.0e38, 3.0e38}, {-1.0e300, 1.0e300}};

}  // namespace

double decode_words(std::span<const std::uint16_t> registers, WordType type, WordLayout layout) {
  const auto count = std::size_t(register_count(type));
  assert(registers.size() >= count);
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint16_t word = registers[layout.high_word_first ? i : count - 1 - i];
    all = all << 16 | (layout.swap_bytes ? bytes_swapped(word) : word);
  }
  switch (type) {
    case WordType::u16:
    case WordType::u32: return double(all);
    case WordType::s16: return static_cast<std::int16_t>(all);
    case WordType::s32: return std::int32_t(all);
    case WordType::f32: return double(std::bit_cast<float>(std::uint32_t(all)));
    case WordType::f64: break;
  }
  return std::bit_cast<double>(all);
}

std::optional<Words> encode_words(double value, WordType type, WordLayout layout) {
  const double wanted = is_floating(type) ? value : std::round(value);
  const Span& range = spans[std::size_t(type)];
  if (!(wanted >= range.min && wanted <= range.max)) return {};
  // Converted through 64 bits, so that negative numbers keep their two's complement.
  const std::uint64_t all = type == WordType::f64   ? std::bit_cast<std::uint64_t>(wanted)
                            : type == WordType::f32 ? std::bit_cast<std::uint32_t>(float(wanted))
                                                    : std::uint64_t(std::int64_t(wanted));
  Words words;
  words.count = register_count(type);
  for (int i = 0; i < words.count; ++i) {
    const auto word = std::uint16_t(all >> (16 * i));
    const int place = layout.high_word_first ? words.count - 1 - i : i;
    words.value[std::size_t(place)] = layout.swap_bytes ? bytes_swapped(word) : word;
  }
  return words;
}

// ---- frames ----

namespace {

void append_word(std::string& bytes, int word) {
  bytes += char(word >> 8);
  bytes += char(word);
}

std::uint16_t modbus_crc(std::string_view bytes) {
  static const Crc crc({16, 0x8005, 0xFFFF, true, true, 0});
  return std::uint16_t(crc(std::as_bytes(std::span(bytes))));
}

std::string begun(int unit, int function) { return {char(unit), char(function)}; }

Frame reply(const ModbusRequest& request, const std::string& body, bool tcp) {
  const std::string frame = framed(body, tcp ? std::optional(request.transaction) : std::nullopt);
  return {frame.begin(), frame.end()};
}

// Returns the length of unit + PDU of a request; 0: more bytes are needed.
std::size_t body_length(std::string_view body) {
  if (body.size() < 2) return 0;
  if (body[1] != 15 && body[1] != 16) return 6;
  return body.size() < 7 ? 0 : 7 + std::size_t{static_cast<unsigned char>(body[6])};
}

ModbusRequest parsed(std::string_view body) {
  ModbusRequest request;
  request.unit = static_cast<unsigned char>(body[0]);
  request.function = static_cast<unsigned char>(body[1]);
  if (body.size() < 6) {
    request.well_formed = false;
    return request;
  }
  request.address = word_at(body, 2);
  if (request.function == 6) {
    request.count = 1;
    request.values.push_back(word_at(body, 4));
    return request;
  }
  request.count = word_at(body, 4);
  request.well_formed = request.count >= 1 && request.count <= 125 && request.address + request.count <= 65536;
  if (request.function == 16) {
    const auto bytes = std::size_t(2 * request.count);
    request.well_formed =
        request.well_formed && body.size() == 7 + bytes && static_cast<unsigned char>(body[6]) == bytes;
    if (request.well_formed)
      for (std::size_t i = 7; i + 1 < body.size(); i += 2) request.values.push_back(word_at(body, i));
  }
  return request;
}

}  // namespace

std::string read_body(int unit, int function, int address, int count) {
  std::string body = begun(unit, function);
  append_word(body, address);
  append_word(body, count);
  return body;
}

std::string write_body(int unit, int function, int address, std::span<const std::uint16_t> values) {
  std::string body = begun(unit, function);
  append_word(body, address);
  if (function == 16) {
    append_word(body, int(values.size()));
    body += char(2 * values.size());
  }
  for (const std::uint16_t value : values) append_word(body, value);
  return body;
}

std::string framed(std::string_view body, std::optional<std::uint16_t> transaction) {
  std::string frame;
  if (transaction) {
    append_word(frame, *transaction);
    append_word(frame, 0);
    append_word(frame, int(body.size()));
    return frame.append(body);
  }
  const std::uint16_t crc = modbus_crc(body);
  frame = body;
  frame += char(crc);
  frame += char(crc >> 8);
  return frame;
}

std::optional<ModbusRequest> next_request(Frame& bytes, bool tcp) {
  const auto drop = [&bytes](std::size_t n) { bytes.erase(bytes.begin(), bytes.begin() + std::ptrdiff_t(n)); };
  const std::string all(bytes.begin(), bytes.end());
  if (tcp) {
    if (all.size() < tcp_header + 2) return {};
    const std::size_t length = word_at(all, 4);
    if (all.size() < tcp_header + length) return {};
    std::optional<ModbusRequest> request;
    if (length >= 2 && word_at(all, 2) == 0) {
      request = parsed(std::string_view(all).substr(tcp_header, length));
      request->transaction = word_at(all, 0);
    }
    drop(tcp_header + length);
    return request;
  }
  for (std::string_view left = all; !left.empty(); left.remove_prefix(1), drop(1)) {
    const std::size_t length = body_length(left);
    if (length == 0 || left.size() < length + 2) return {};
    const std::string_view body = left.substr(0, length);
    if (framed(body, {}) != left.substr(0, length + 2)) continue;
    drop(length + 2);
    return parsed(body);
  }
  return {};
}

Frame read_reply(const ModbusRequest& request, std::span<const std::uint16_t> values, bool tcp) {
  std::string body = begun(request.unit, request.function);
  body += char(2 * values.size());
  for (const std::uint16_t value : values) append_word(body, value);
  return reply(request, body, tcp);
}

Frame write_reply(const ModbusRequest& request, bool tcp) {
  std::string body = begun(request.unit, request.function);
  append_word(body, request.address);
  append_word(body, request.function == 6 ? request.values.front() : request.count);
  return reply(request, body, tcp);
}

Frame exception_reply(const ModbusRequest& request, int exception, bool tcp) {
  std::string body = begun(request.unit, request.function | 0x80);
  body += char(exception);
  return reply(request, body, tcp);
}

}  // namespace turncal
