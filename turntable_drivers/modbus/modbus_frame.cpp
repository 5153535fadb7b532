#include "turntable_drivers/modbus/modbus_frame.h"

namespace turncal {
namespace {

std::uint16_t word_at(std::span<const std::uint8_t> bytes, std::size_t i) {
  return static_cast<std::uint16_t>(bytes[i] << 8 | bytes[i + 1]);
}

void append_big_endian(Frame& frame, int value) {
  frame.push_back(static_cast<std::uint8_t>(value >> 8));
  frame.push_back(static_cast<std::uint8_t>(value));
}

// Unit and PDU to what goes over the wire.
Frame wrapped(const ModbusRequest& request, const Frame& body, bool tcp) {
  Frame frame;
  if (tcp) {
    append_big_endian(frame, request.transaction);
    append_big_endian(frame, 0);
    append_big_endian(frame, static_cast<int>(body.size()));
    frame.insert(frame.end(), body.begin(), body.end());
  } else {
    frame = body;
    const std::uint16_t crc = modbus_crc(body);
    frame.push_back(static_cast<std::uint8_t>(crc));
    frame.push_back(static_cast<std::uint8_t>(crc >> 8));
  }
  return frame;
}

Frame body_of(const ModbusRequest& request) {
  return {static_cast<std::uint8_t>(request.unit), static_cast<std::uint8_t>(request.function)};
}

// Bytes of unit + PDU; 0: more are needed to tell.
std::size_t body_length(std::span<const std::uint8_t> body) {
  if (body.size() < 2) return 0;
  if (body[1] != 15 && body[1] != 16) return 6;
  return body.size() < 7 ? 0 : 7 + std::size_t{body[6]};
}

ModbusRequest parsed(std::span<const std::uint8_t> body) {
  ModbusRequest request;
  request.unit = body[0];
  request.function = body[1];
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
    const auto bytes = static_cast<std::size_t>(2 * request.count);
    request.well_formed = request.well_formed && body.size() == 7 + bytes && body[6] == bytes;
    if (request.well_formed) {
      for (std::size_t i = 7; i + 1 < body.size(); i += 2) request.values.push_back(word_at(body, i));
    }
  }
  return request;
}

}  // namespace

std::uint16_t modbus_crc(std::span<const std::uint8_t> bytes) {
  unsigned crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int i = 0; i < 8; ++i) crc = (crc & 1) != 0 ? crc >> 1 ^ 0xA001 : crc >> 1;
  }
  return static_cast<std::uint16_t>(crc);
}

std::optional<ModbusRequest> next_request(std::vector<std::uint8_t>& bytes, bool tcp) {
  const auto drop = [&bytes](std::size_t n) {
    bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
  };
  if (tcp) {
    if (bytes.size() < 8) return {};
    const std::size_t length = word_at(bytes, 4);
    if (bytes.size() < 6 + length) return {};
    std::optional<ModbusRequest> request;
    if (length >= 2 && word_at(bytes, 2) == 0) {
      request = parsed(std::span(bytes).subspan(6, length));
      request->transaction = word_at(bytes, 0);
    }
    drop(6 + length);
    return request;
  }
  while (!bytes.empty()) {
    const std::size_t length = body_length(bytes);
    if (length == 0 || bytes.size() < length + 2) return {};
    const std::uint16_t crc = static_cast<std::uint16_t>(bytes[length] | bytes[length + 1] << 8);
    if (crc == modbus_crc(std::span(bytes).first(length))) {
      const ModbusRequest request = parsed(std::span(bytes).first(length));
      drop(length + 2);
      return request;
    }
    drop(1);
  }
  return {};
}

Frame read_reply(const ModbusRequest& request, std::span<const std::uint16_t> values, bool tcp) {
  Frame body = body_of(request);
  body.push_back(static_cast<std::uint8_t>(2 * values.size()));
  for (const std::uint16_t value : values) append_big_endian(body, value);
  return wrapped(request, body, tcp);
}

Frame write_reply(const ModbusRequest& request, bool tcp) {
  Frame body = body_of(request);
  append_big_endian(body, request.address);
  append_big_endian(body, request.function == 6 ? request.values.front() : request.count);
  return wrapped(request, body, tcp);
}

Frame exception_reply(const ModbusRequest& request, int exception, bool tcp) {
  Frame body = body_of(request);
  body[1] = static_cast<std::uint8_t>(body[1] | 0x80);
  body.push_back(static_cast<std::uint8_t>(exception));
  return wrapped(request, body, tcp);
}

}  // namespace turncal
