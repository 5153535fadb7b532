#include "turntable_drivers/modbus/register_codec.h"

#include <fmt/format.h>

#include "imu_io/base/text.h"
#include "turntable_drivers/modbus/modbus_frame.h"

namespace turncal {
namespace {

constexpr double busy_pause_s = 0.05;          // before a busy drive is asked again
constexpr std::uint16_t most_repeated = 1000;  // the number of past transactions whose replies may be repeated
constexpr std::size_t longest_frame = 260;

const char* exception_text(int exception) {
  switch (exception) {
    case 1: return "illegal function";
    case 2: return "illegal data address";
    case 3: return "illegal data value";
    case 4: return "device failure";
    case 5: return "acknowledged, still at work";
    case 6: return "busy";
    case 10: return "gateway path unavailable";
    case 11: return "device behind the gateway does not answer";
    default: return "unknown";
  }
}

Judgement exception_judgement(int exception) {
  const std::string text = fmt::format("exception {} ({})", exception, exception_text(exception));
  Judgement judgement = exception >= 1 && exception <= 3 ? input_error(text + ": expected a map that fits the drive")
                                                         : device_error(text);
  judgement.again = exception > 4 && exception != 7 && exception != 8;
  judgement.pause_s = busy_pause_s;
  judgement.alive = exception < 10;
  return judgement;
}

std::uint16_t transaction_of(const TableRequest& request) { return word_at(request.bytes, 0); }

bool is_read(char function) { return function == 3 || function == 4; }

}  // namespace

std::string ModbusFraming::framed(const std::string& body) {
  return turncal::framed(body, header_ ? std::optional(++transaction_) : std::nullopt);
}

// True for a frame of an earlier transaction. REQUIRES: a complete header.
bool ModbusFraming::is_of_earlier(const std::string& frame) const {
  const std::size_t size = tcp_header + word_at(frame, 4);
  return word_at(frame, 2) == 0 && size > tcp_header && size <= longest_frame &&
         std::uint16_t(transaction_ - word_at(frame, 0)) < most_repeated;
}

std::optional<std::size_t> ModbusFraming::reply_end(const TableRequest& request, std::string& heard,
                                                    bool at_once) const {
  if (at_once) {  // skips anything before the acknowledgement
    const std::string expected =
        turncal::framed(request.body.substr(0, 6), header_ ? std::optional(transaction_of(request)) : std::nullopt);
    const std::size_t at = heard.find(expected);
    if (at == std::string::npos) return {};
    heard.erase(0, at);
    return expected.size();
  }
  if (header_) {
    for (;;) {
      if (heard.size() < tcp_header) return {};
      const std::size_t size = tcp_header + word_at(heard, 4);
      if (word_at(heard, 2) != 0 || size > longest_frame) return heard.size();
      if (heard.size() < size) return {};
      if (word_at(heard, 0) == transaction_of(request) || !is_of_earlier(heard)) return size;
      heard.erase(0, size);
    }
  }
  const char function = request.body[1];
  if (heard.size() < 3) return {};
  const std::size_t size = heard[1] == char(function | 0x80) ? 5
                           : heard[1] != function            ? heard.size()
                           : is_read(function)               ? 5U + static_cast<unsigned char>(heard[2])
                                                             : 8;
  return heard.size() < size ? std::nullopt : std::optional(size);
}

Judgement ModbusFraming::judge(const TableRequest& request, const std::string& reply, std::string& heard,
                               std::vector<std::uint16_t>& registers) const {
  std::string body = reply;
  if (header_) {
    if (reply.size() < tcp_header) return garbled("rubbish");
    if (word_at(reply, 2) != 0) return garbled(fmt::format("protocol {} answered, not Modbus", word_at(reply, 2)));
    if (word_at(reply, 0) != transaction_of(request)) return garbled("the reply of another transaction");
    body.erase(0, tcp_header);
  } else {
    if (body.size() < 5 || turncal::framed(body.substr(0, body.size() - 2), {}) != body) return garbled("Invalid CRC");
    body.resize(body.size() - 2);
  }
  if (body.size() < 3) return garbled("rubbish");
  const char function = request.body[1];
  if (body[0] != request.body[0]) return garbled(fmt::format("unit {} answered", static_cast<unsigned char>(body[0])));
  const bool is_exception = body[1] == char(function | 0x80) && body.size() == 3;
  if (!is_exception) {
    if (body[1] != function) return garbled("the reply to another function");
    const std::size_t bytes = 2U * word_at(request.body, 4);  // bytes of a reading
    const bool same = is_read(function) ? body.size() == 3 + bytes && static_cast<unsigned char>(body[2]) == bytes
                                        : body == request.body.substr(0, 6);
    if (!same) return garbled("the reply to another request");
  }
  if (has_unexpected(heard)) return garbled("bytes after the reply");
  if (is_exception) return exception_judgement(static_cast<unsigned char>(body[2]));
  if (is_read(function))
    for (std::size_t at = 3; at < body.size(); at += 2) registers.push_back(word_at(body, at));
  return {};
}

bool ModbusFraming::has_unexpected(std::string& heard) const {
  while (header_ && heard.size() >= tcp_header && is_of_earlier(heard)) {
    const std::size_t size = tcp_header + word_at(heard, 4);
    if (heard.size() < size) return false;  // incomplete: the next reading skips the frame by its transaction number
    heard.erase(0, size);
  }
  return header_ ? heard.size() >= tcp_header : !heard.empty();
}

namespace {

class RegisterCodec : public TableCodec {
 public:
  explicit RegisterCodec(const RegisterMap& map) : map_(map), framing_(map.link.header()) {}

  std::size_t steps(TableOperation operation) const override {
    if (operation == TableOperation::heartbeat) return 1;
    return operation == TableOperation::status ? map_.blocks().size() : map_.list(operation).size();
  }
  bool once(TableOperation operation) const override {
    return operation == TableOperation::heartbeat ? map_.heartbeat_of_table : map_.once(operation);
  }
  double pause_s(TableOperation operation, std::size_t step) const override {
    return operation == TableOperation::heartbeat ? 0.0 : map_.list(operation)[step].wait_s;
  }
  const AxisScale& scale(Axis axis) const override { return map_.of(axis); }
  bool tells(DriveBit bit) const override { return map_.of(Axis::heading).bit(bit).has_value(); }
  bool moves_all() const override { return map_.once(TableOperation::move); }
  bool searches() const override { return !map_.home_by_encoder; }
  double heartbeat_s() const override { return map_.heartbeat_address ? map_.heartbeat_period_s : 0.0; }
  const char* kind() const override { return "map"; }
  const char* implausible() const override { return "a map with the drive's word order and scale"; }
  const char* expected_scale() const override { return "other counts_per_degree or zero_deg"; }
  const char* expected_angle() const override {
    return "other settings fit as well: expected an angle that tells them apart";
  }

  Result<TableRequest> encode(TableOperation operation, Axis axis, std::size_t step, const Moves& moves) override {
    TableRequest request{operation, axis, step};
    const MapAxis& place = map_.of(axis);
    if (operation == TableOperation::status) {
      const StatusBlock& block = map_.blocks()[step];
      // The length depends on the axis, so that no two requests have the same length; the extra registers are discarded.
      request.body = read_body(place.unit, map_.status_function, block.read_at(place), block.count + int(index(axis)));
    } else if (operation == TableOperation::heartbeat) {
      // A new value each time, which a drive can tell from a hung master.
      const std::size_t beats = beats_[index(axis)];
      const std::vector<std::uint16_t>& values = map_.heartbeat_values;
      const std::uint16_t value = values.empty() ? std::uint16_t(1 + beats % 0xFFFF) : values[beats % values.size()];
      request.body = write_body(place.unit, map_.write_function, map_.heartbeat_at(axis), std::span(&value, 1));
    } else {
      const WriteStep& write = map_.list(operation)[step];
      const std::vector<std::uint16_t> words = TRY(words_of(map_, write, axis, moves));
      request.body = write_body(map_.unit_of(operation, axis), words.size() > 1 ? 16 : map_.write_function,
                                map_.address_of(write, operation, axis), words);
    }
    request.bytes = framing_.framed(request.body);
    return request;
  }

  std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const override {
    return framing_.reply_end(request, heard, at_once);
  }

  Judgement decode(const TableRequest& request, const std::string& reply, std::string& heard,
                   AxisReading* reading) override {
    std::vector<std::uint16_t> registers;
    const Judgement judgement = framing_.judge(request, reply, heard, registers);
    if (!judgement.status) return judgement;
    if (request.operation == TableOperation::heartbeat) ++beats_[index(request.axis)];
    if (request.operation != TableOperation::status) return {};
    for (const StatusBlock& block : map_.blocks())
      if (block.read_at(map_.of(request.axis)) == word_at(request.body, 2) &&
          registers.size() == std::size_t(block.count) + index(request.axis))
        take(request.axis, block, registers, *reading);
    return {};
  }

  bool acknowledges(const TableRequest&, const std::string&) const override { return true; }  // reply_end() checks it

  bool has_unexpected(std::string& heard) const override { return framing_.has_unexpected(heard); }

  std::string message(const TableRequest& request, const std::string& whose, const std::string& what) const override {
    const std::string address = map_.link.address + ": ";
    const bool reads = request.operation == TableOperation::status;
    return fmt::format("{}{}{}{} unit {} register {}: {}", whose,
                       reads ? "" : std::string(to_string(request.operation)) + ": ", address,
                       reads ? "reading" : "writing", static_cast<unsigned char>(request.body[0]),
                       word_at(request.body, 2), what.starts_with(address) ? what.substr(address.size()) : what);
  }

  std::vector<OtherReading> other_readings(Axis axis, const AxisReading&) const override {
    std::vector<OtherReading> others;
    MapAxis scale = map_.of(axis);
    const int own_sign = scale.sign;
    for (const bool high_first : {true, false}) {
      for (const bool swap : {false, true}) {
        for (const int sign : {1, -1}) {
          const bool same_order = high_first == map_.layout.high_word_first;
          if (same_order && swap == map_.layout.swap_bytes && sign == own_sign) continue;
          if (register_count(scale.position.type) == 1 && !same_order) continue;
          scale.sign = sign;
          others.push_back(
              {scale.angle_of(decode_words(position_words_[index(axis)], scale.position.type, {high_first, swap})),
               fmt::format("words.order = {}, words.swap_bytes = {}, sign = {}",
                           high_first ? "high_first" : "low_first", swap, sign)});
        }
      }
    }
    return others;
  }

 private:
  // Takes the axis's values from a block.
  void take(Axis axis, const StatusBlock& block, const std::vector<std::uint16_t>& registers, AxisReading& reading) {
    const MapAxis& scale = map_.of(axis);
    const auto words_from = [&](int address) {
      return std::span(registers).subspan(std::size_t(address - block.address));
    };
    const auto number = [&](const RegisterField& field) {
      return decode_words(words_from(field.address), field.type, map_.layout);
    };
    if (block.holds(scale.position.address)) {
      reading.position_deg = scale.angle_of(number(scale.position));
      const auto words = words_from(scale.position.address);
      position_words_[index(axis)].assign(words.begin(), words.begin() + register_count(scale.position.type));
    }
    if (scale.rate && block.holds(scale.rate->address))
      reading.rate_degps = scale.sign * number(*scale.rate) / scale.measured_rate_scale;
    for (std::size_t i = 0; i < scale.bits.size(); ++i) {
      const std::optional<StatusBit>& bit = scale.bits[i];
      if (!bit || !block.holds(bit->address)) continue;
      reading.flags[i] = bit->is_set(words_from(bit->address)[0]);
      reading.raw |= *reading.flags[i] ? 1u << i : 0u;
    }
    if (!scale.alarm || !block.holds(scale.alarm->address)) return;
    const double code = number(*scale.alarm);
    if (code == 0.0) return;
    const auto text = map_.alarm_text.find(long(code));
    reading.text = "alarm " + format_number(code) + (text != map_.alarm_text.end() ? " (" + text->second + ")" : "");
  }

  const RegisterMap map_;
  ModbusFraming framing_;
  std::array<std::size_t, 3> beats_{};
  std::array<std::vector<std::uint16_t>, 3> position_words_;  // at the last reading
};

}  // namespace

std::unique_ptr<TableCodec> codec_of(const RegisterMap& map) { return std::make_unique<RegisterCodec>(map); }

}  // namespace turncal
