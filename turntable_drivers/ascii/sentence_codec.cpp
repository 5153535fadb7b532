#include "turntable_drivers/ascii/sentence_codec.h"

#include <fmt/format.h>

#include <map>

#include "imu_io/base/text.h"

namespace turncal {

std::optional<std::size_t> SentenceFraming::reply_end(const std::string& heard, int lines, bool at_once) const {
  std::size_t end = 0;
  const auto past = [&](const std::string& mark) {
    const std::size_t at = heard.find(mark, end);
    if (at != std::string::npos) end = at + mark.size();
    return at != std::string::npos;
  };
  if (link_.echo && !at_once && !past(link_.echo_terminator)) return {};
  if (at_once || !link_.prompt.empty()) lines = 1;
  for (int i = 0; i < lines; ++i)
    if (!past(end_of_answer())) return {};
  return end;
}

Result<std::string> SentenceFraming::answer(const std::string& sent_body, const std::string& reply,
                                            const std::string& heard, int lines) const {
  std::string frames = reply;
  if (link_.echo) {
    const std::string sent = frame_of(link_, sent_body);
    const std::size_t end = frames.find(link_.echo_terminator);
    const std::string echo = frames.substr(0, end);
    if (!echo.ends_with(sent))
      return device_error(fmt::format("echo '{}': expected '{}'", visible(echo), visible(sent)));
    frames.erase(0, end + link_.echo_terminator.size());
  }
  if (!link_.prompt.empty()) frames.resize(frames.size() - link_.prompt.size());
  Result<std::string> bodies = bodies_of(frames, lines);
  if (bodies && !heard.empty() && (lines > 0 || !link_.prompt.empty())) {
    if (frames.ends_with(link_.terminator_in)) frames.resize(frames.size() - link_.terminator_in.size());
    return device_error(fmt::format("answer '{}': more after it: '{}'", visible(frames), visible(heard)));
  }
  return bodies;
}

Result<std::string> SentenceFraming::bodies_of(const std::string& frames, int lines) const {
  const std::string& end = link_.terminator_in;
  std::string remaining = frames;
  if (remaining.ends_with(end)) remaining.resize(remaining.size() - end.size());
  std::string bodies;
  int count = 0;
  for (bool more = !remaining.empty() || lines > 0; more;) {
    const std::size_t at = remaining.find(end);
    more = at != std::string::npos;
    bodies += (count++ > 0 ? "\n" : "") + TRY(body_of(link_, remaining.substr(0, at)));
    if (more) remaining.erase(0, at + end.size());
  }
  if (count == lines || (lines == 0 && count == 1)) return bodies;  // the codec judges unexpected lines
  return device_error(fmt::format("answer '{}': expected {}", visible(frames),
                                  lines > 1 ? std::to_string(lines) + " lines" : std::string("one line")));
}

namespace {

using Values = std::map<std::string, std::string>;

class SentenceCodec : public TableCodec {
 public:
  explicit SentenceCodec(const Dialect& dialect)
      : dialect_(dialect), framing_(dialect.link), moves_all_(turncal::moves_all(dialect)) {}

  std::size_t steps(TableOperation operation) const override { return dialect_.of(operation).exchanges.size(); }
  bool once(TableOperation operation) const override { return !dialect_.of(operation).each_axis; }
  const AxisScale& scale(Axis axis) const override { return dialect_.of(axis); }
  bool tells(DriveBit bit) const override { return dialect_.status.reports(bit); }
  bool moves_all() const override { return moves_all_; }
  const char* kind() const override { return "dialect"; }
  const char* expected_scale() const override { return "other units_per_degree or zero_deg"; }
  const char* expected_angle() const override { return "the other sign fits as well: expected another angle"; }

  Result<TableRequest> encode(TableOperation operation, Axis axis, std::size_t step, const Moves& moves) override {
    if (operation == TableOperation::move) TRY(check_sentences(dialect_, axis, moves));
    const Exchange& exchange = dialect_.of(operation).exchanges[step];
    TableRequest request{operation, axis, step};
    request.body = filled(dialect_, exchange.send, axis, moves);
    request.bytes = framing_.framed(request.body);
    request.answered = exchange.expect.has_value();
    return request;
  }

  std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const override {
    return framing_.reply_end(heard, lines_of(request), at_once);
  }

  Judgement decode(const TableRequest& request, const std::string& reply, std::string& heard,
                   AxisReading* reading) override {
    const auto& expect = dialect_.of(request.operation).exchanges[request.step].expect;
    const Result<std::string> answer = framing_.answer(request.body, reply, heard, lines_of(request));
    if (!answer) return framing_.garbled(answer.error().message);
    if (request.operation == TableOperation::identify) reading->text = visible(*answer);
    for (const std::string& text : dialect_.errors)
      if (answer->find(text) != std::string::npos) return device_error("the device says '" + visible(*answer) + "'");
    if (!expect)
      return answer->empty() ? Judgement() : device_error("answer '" + visible(*answer) + "': expected none");
    const std::optional<Values> values = expect->match(*answer);
    if (!values)
      return device_error(fmt::format("answer '{}': expected '{}'", visible(*answer), visible(expect->text())));
    const auto named = values->find("axis");
    if (named != values->end() && named->second != dialect_.of(request.axis).name)
      return device_error("axis '" + named->second + "' answered");
    if (request.operation == TableOperation::status) TRY(take(request.axis, *values, *reading));
    return {};
  }

  bool acknowledges(const TableRequest& request, const std::string& reply) const override {
    const auto body = body_of(dialect_.link, reply.substr(0, reply.size() - framing_.end_of_answer().size()));
    return body && dialect_.of(request.operation).exchanges[request.step].expect->match(*body);
  }

  bool has_unexpected(std::string& heard) const override { return !heard.empty(); }

  std::string message(const TableRequest& request, const std::string& whose, const std::string& what) const override {
    const bool reads = request.operation == TableOperation::status;
    return fmt::format("{}{}'{}': {}", reads ? "" : key_of(request.operation) + ": ", whose, visible(request.body),
                       what);
  }

  std::vector<OtherReading> other_readings(Axis axis, const AxisReading& reading) const override {
    const DialectAxis& scale = dialect_.of(axis);
    return {{2.0 * scale.zero_deg - reading.position_deg, fmt::format("sign = {}", -scale.sign)}};
  }

 private:
  int lines_of(const TableRequest& request) const {
    const auto& expect = dialect_.of(request.operation).exchanges[request.step].expect;
    return expect ? expect->lines() : 0;
  }

  // Takes the axis's values from an answer.
  Status take(Axis axis, const Values& values, AxisReading& reading) const {
    const DialectAxis& scale = dialect_.of(axis);
    for (const auto& [name, text] : values) {
      const Asked asked = asked_by(name, axis);
      if (asked.axis != axis) continue;
      if (asked.status) {
        const AxisReading said = flags_of(dialect_.status, text);
        reading.flags = said.flags;
        reading.known = said.known;
        reading.raw = said.raw;
      }
      if (asked.number != MoveQuantity::position && asked.number != MoveQuantity::rate) continue;
      const std::optional<double> value = device_number(text);
      if (!value)
        return device_error(fmt::format("{} '{}': expected a number", to_string(*asked.number), visible(text)));
      if (asked.number == MoveQuantity::position) reading.position_deg = scale.angle_of(*value);
      if (asked.number == MoveQuantity::rate) reading.rate_degps = scale.sign * *value / scale.measured_rate_scale;
    }
    return {};
  }

  const Dialect dialect_;
  const SentenceFraming framing_;
  const bool moves_all_;
};

}  // namespace

std::unique_ptr<TableCodec> codec_of(const Dialect& dialect) { return std::make_unique<SentenceCodec>(dialect); }

}  // namespace turncal
