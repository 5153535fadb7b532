#include "turntable_drivers/ascii/dialect.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <span>

#include "imu_io/base/file_kind.h"
#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"

namespace turncal {

std::optional<SentenceTemplate> SentenceTemplate::parse(std::string_view text) {
  SentenceTemplate result;
  result.text_ = text;
  while (!text.empty()) {
    if (text.front() == '}') return {};
    if (text.front() != '{') {
      const std::size_t end = text.find_first_of("{}");
      result.pieces_.push_back({std::string(text.substr(0, end)), ""});
      text.remove_prefix(end == std::string_view::npos ? text.size() : end);
      continue;
    }
    const std::size_t close = text.find_first_of("{}", 1);
    if (close == std::string_view::npos || text[close] != '}' || close == 1) return {};
    if (!result.pieces_.empty() && !result.pieces_.back().name.empty() && result.pieces_.back().width == 0) return {};
    Piece piece{"", std::string(text.substr(1, close - 1))};
    if (const std::size_t colon = piece.name.find(':'); colon != std::string::npos) {
      const std::optional<int> width = parse_integer<int>(std::string_view(piece.name).substr(colon + 1));
      if (!width || *width < 1 || *width > 64 || colon == 0) return {};
      piece.width = std::size_t(*width);
      piece.name.resize(colon);
    }
    result.pieces_.push_back(std::move(piece));
    text.remove_prefix(close + 1);
  }
  return result;
}

std::string SentenceTemplate::fill(const std::function<std::string(const std::string&)>& value) const {
  std::string text;
  for (const Piece& piece : pieces_) {
    std::string filled = piece.name.empty() ? piece.literal : value(piece.name);
    if (filled.size() < piece.width) {
      const bool sign = filled.starts_with('-') || filled.starts_with('+');
      const bool number =
          filled.size() > (sign ? 1U : 0U) && std::isdigit(static_cast<unsigned char>(filled[sign])) != 0;
      filled.insert(number && sign ? 1 : 0, piece.width - filled.size(), number ? '0' : ' ');
    }
    text += filled;
  }
  return text;
}

std::optional<std::map<std::string, std::string>> SentenceTemplate::match(std::string_view sentence) const {
  std::map<std::string, std::string> values;
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const Piece& piece = pieces_[i];
    if (piece.name.empty()) {
      if (!sentence.starts_with(piece.literal)) return {};
      sentence.remove_prefix(piece.literal.size());
      continue;
    }
    const bool last = i + 1 == pieces_.size();
    if (piece.width > sentence.size()) return {};
    const std::size_t end = piece.width > 0 ? piece.width
                            : last          ? sentence.size()
                                            : sentence.find(pieces_[i + 1].literal, piece.name == "*" ? 0 : 1);
    if (end == std::string_view::npos) return {};
    std::string_view value = sentence.substr(0, end);
    if (piece.width > 0) value = trimmed(value);
    if (piece.name != "*") {
      if (value.empty() || value.find_first_of(", \t\n") != std::string_view::npos) return {};
      values[piece.name] = value;
    }
    sentence.remove_prefix(end);
  }
  if (!sentence.empty()) return {};
  return values;
}

int SentenceTemplate::lines() const { return 1 + int(std::ranges::count(text_, '\n')); }

bool SentenceTemplate::has(std::string_view name) const {
  return std::ranges::any_of(pieces_, [&](const Piece& piece) { return piece.name == name; });
}

std::vector<std::string> SentenceTemplate::names() const {
  std::vector<std::string> result;
  for (const Piece& piece : pieces_)
    if (!piece.name.empty()) result.push_back(piece.name);
  return result;
}

std::size_t SentenceTemplate::width_of(std::string_view name) const {
  const auto place = std::ranges::find_if(pieces_, [&](const Piece& piece) { return piece.name == name; });
  return place == pieces_.end() ? 0 : place->width;
}

std::string check_digits(std::string_view body, SentenceCheck check, const CrcParameters& crc) {
  constexpr const char* digits = "0123456789ABCDEF";
  if (check == SentenceCheck::crc16) {
    const unsigned sum = Crc(crc)(std::as_bytes(std::span(body.data(), body.size())));
    return {digits[sum >> 12 & 15], digits[sum >> 8 & 15], digits[sum >> 4 & 15], digits[sum & 15]};
  }
  unsigned value = 0;
  for (const char c : body) {
    const auto byte = static_cast<unsigned char>(c);
    value = check == SentenceCheck::sum8 ? value + byte : value ^ byte;
  }
  return {digits[value >> 4 & 15], digits[value & 15]};
}

std::optional<std::string> unescaped(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\\') {
      result += text[i];
      continue;
    }
    if (++i == text.size()) return {};
    switch (text[i]) {
      case 'r': result += '\r'; break;
      case 'n': result += '\n'; break;
      case 't': result += '\t'; break;
      case '\\': result += '\\'; break;
      default: return {};
    }
  }
  return result;
}

// ---- the dialect ----

namespace {

bool placeholder_is_known(const std::string& name) {
  const Asked asked = asked_by(name, Axis::heading);
  return name == "axis" || name == "*" || asked.number || asked.status;
}

std::optional<SentenceTemplate> sentence(KeyValueFile& file, const std::string& key) {
  std::string text = file.text(key);
  if (key.ends_with(".expect"))
    for (std::size_t at = text.find("\\n"); at != std::string::npos; at = text.find("\\n", at))
      text.replace(at, 2, "\n");
  const auto result = SentenceTemplate::parse(text);
  bool good = result.has_value();
  if (good)
    for (const std::string& name : result->names()) good = good && placeholder_is_known(name);
  if (!good) {
    file.reject(
        key,
        "a sentence with {axis} {position} {distance} {rate} {acceleration} {status} {*} or one of these with .heading "
        ".pitch .roll, something between any two of them unless they have a width, {position:10}");
    return {};
  }
  return result;
}

std::string escaped_text(KeyValueFile& file, const std::string& key, const std::string& otherwise) {
  if (!file.has(key)) return otherwise;
  const auto text = unescaped(file.text_or(key, ""));
  if (!text) file.reject(key, "text with \\r \\n \\t or \\\\");
  return text.value_or("");
}

// Reads a 16-bit number, decimal or with 0x.
std::uint32_t crc_number(KeyValueFile& file, const std::string& key, std::optional<std::uint32_t> otherwise) {
  if (otherwise && !file.has(key)) return *otherwise;
  const auto value = parse_whole<std::uint16_t>(file.text(key));
  if (!value) file.reject(key, "a number of 16 bits, decimal or with 0x");
  return value.value_or(0);
}

template <class Wanted>
bool sends_any(const DialectSteps& steps, Wanted wanted) {  // of placeholders by name
  return std::ranges::any_of(
      steps.exchanges, [&](const Exchange& exchange) { return std::ranges::any_of(exchange.send.names(), wanted); });
}

bool is_of_axis(const std::string& name) { return name == "axis" || name.ends_with(".heading"); }

void read_steps(KeyValueFile& file, Dialect& dialect) {
  for (const TableOperation operation : all_operations) {
    const std::string name = key_of(operation);
    DialectSteps& steps = dialect.steps[index(operation)];
    steps.each_axis = file.one_of_or(name + ".scope", "axis", {"axis", "table"}) == "axis";
    for (int number = 1; file.has(name + "." + std::to_string(number)); ++number) {
      const std::string key = name + "." + std::to_string(number);
      Exchange exchange;
      if (const auto send = sentence(file, key)) exchange.send = *send;
      if (file.has(key + ".expect")) exchange.expect = sentence(file, key + ".expect");
      steps.exchanges.push_back(std::move(exchange));
    }
    const bool needed = operation == TableOperation::home || operation == TableOperation::move ||
                        operation == TableOperation::status || operation == TableOperation::stop ||
                        operation == TableOperation::abort;
    const bool is_stop = operation == TableOperation::stop || operation == TableOperation::abort;
    for (std::size_t k = 0; is_stop && k < steps.exchanges.size(); ++k) {
      const auto& expect = steps.exchanges[k].expect;
      if (expect && expect->lines() > 1)
        file.reject(name + "." + std::to_string(k + 1) + ".expect", "an answer of one line: a stop waits for no more");
    }
    if (needed && steps.exchanges.empty()) file.text(name + ".1");  // reports the missing key
    const bool commands_axis = operation == TableOperation::enable || operation == TableOperation::home ||
                               operation == TableOperation::move || is_stop;
    if (commands_axis && steps.each_axis && !steps.exchanges.empty() && !sends_any(steps, is_of_axis))
      file.reject(name + ".1", "{axis} in a sentence, or " + name + ".scope = table");
  }
  const auto asks_for = [&](MoveQuantity quantity) {
    const auto is_it = [&](const std::string& name) { return asked_by(name, Axis::heading).number == quantity; };
    return sends_any(dialect.of(TableOperation::move), is_it);
  };
  const bool position = asks_for(MoveQuantity::position), distance = asks_for(MoveQuantity::distance);
  if (file.has("move.1") && position == distance)
    file.reject("move.1", "either {position} or {distance} in the sentences of a move");
  for (const DialectAxis& axis : dialect.axis) {
    if (axis.shorter_way && (distance || !position))
      file.reject("move.1", "{position} in a sentence, not {distance}: way = shorter");
    if (axis.modulo_deg > 0.0 && !axis.shorter_way && (position || !distance))
      file.reject("move.1",
                  "{distance} in a sentence, not {position}: with modulo_deg that does not say how many turns to go, "
                  "unless way = shorter");
  }
}

void read_status(KeyValueFile& file, DialectStatus& status) {
  status.by_bits = file.one_of("status.kind", {"codes", "bits"}) == "bits";
  const auto flag_list = [&](const std::string& key) {
    std::vector<DriveBit> flags;
    for (const std::string& name : file.list(key)) {
      if (name == "none") continue;
      const auto bit = enum_from<DriveBit>(name);
      if (!bit) {
        file.reject(key, "none, or some of " + one_of(name, words_of<DriveBit>()));
        return flags;
      }
      flags.push_back(*bit);
    }
    return flags;
  };
  if (!status.by_bits) {
    for (const std::string& key : file.keys_with_prefix("status.code.")) status.codes[key.substr(12)] = flag_list(key);
    if (status.codes.empty()) file.text("status.code.0");  // reports the missing key
  } else {
    status.base = file.one_of_or("status.base", "10", {"10", "16"}) == "16" ? 16 : 10;
    for (const DriveBit flag : all_drive_bits) {
      const std::string key = fmt::format("status.bit.{}", to_string(flag));
      for (const std::string& text : file.list_or(key, {})) {
        const std::optional<int> bit = parse_integer<int>(text);
        if (bit && *bit >= 0 && *bit <= 31)
          status.mask[index(flag)] |= 1u << *bit;
        else
          file.reject(key, "numbers of bits from 0 to 31, separated by commas");
      }
    }
    if (file.has("status.active_low"))
      for (const DriveBit bit : flag_list("status.active_low")) status.active_low[index(bit)] = true;
  }
  if (!status.reports(DriveBit::in_position))
    file.reject("status.kind", "a code or a bit for in_position: what does not say that it has arrived never has");
}

Result<Dialect> dialect_from(KeyValueFile& file) {
  Dialect dialect;
  KeyTable keys(file);
  read_table_description(file, dialect);
  read_dialect_link(file, dialect.link);
  for (const Axis which : all_axes) {
    DialectAxis& axis = dialect.axis[index(which)];
    const std::string prefix = fmt::format("axis.{}.", to_string(which));
    axis.name = file.text(prefix + "name");
    read_axis_scale(file, which, axis, "units_per_degree", true);
    keys.chosen(prefix + "way", axis.shorter_way, {"told", "shorter"});
    if (axis.shorter_way && axis.modulo_deg == 0.0) file.reject(prefix + "way", "no such key without modulo_deg");
  }
  keys.whole("number.decimals", dialect.decimals, 0, 9);
  keys.flag("number.plus", dialect.plus);
  read_steps(file, dialect);
  // Questions are skipped: they command nothing.
  const auto last_command = [&](TableOperation operation) -> std::pair<std::string, std::size_t> {
    const std::vector<Exchange>& all = dialect.of(operation).exchanges;
    for (std::size_t i = all.size(); i-- > 0;)
      if (all[i].send.text().find('?') == std::string::npos) return {all[i].send.text(), i + 1};
    return {};
  };
  const auto [abort, number] = last_command(TableOperation::abort);
  if (dialect.can_switch_off && number > 0 && abort == last_command(TableOperation::stop).first)
    file.reject("abort." + std::to_string(number),
                "a sentence that switches the drives off, unlike that of stop; or switch_off = false where none does");
  if (file.has("error.texts")) dialect.errors = file.list("error.texts");
  read_status(file, dialect.status);
  TRY(file.check_all_used());
  check_dialect(file, dialect);
  TRY(file.status());
  if (const auto clash = sentence_clash(dialect)) return file.error_at(clash->key, clash->expected);
  return dialect;
}

}  // namespace

void read_dialect_link(KeyValueFile& file, DialectLink& link) {
  KeyTable keys(file);
  link.tcp = file.one_of("link.kind", {"serial", "tcp"}) == "tcp";
  keys.text("link.address", link.address);
  if (!link.tcp) link.serial.baud = 9600;
  read_serial_keys(keys, "link", link.serial, !link.tcp);
  link.terminator_out = escaped_text(file, "link.terminator_out", link.terminator_out);
  link.terminator_in = escaped_text(file, "link.terminator_in", link.terminator_in);
  if (link.terminator_in.empty()) file.reject("link.terminator_in", "at least one character");
  link.prompt = escaped_text(file, "link.prompt", "");
  keys.flag("link.echo", link.echo);
  link.echo_terminator = link.terminator_out;
  if (link.echo) link.echo_terminator = escaped_text(file, "link.echo_terminator", link.terminator_out);
  if (link.echo && link.echo_terminator.empty()) file.reject("link.echo_terminator", "at least one character");
  keys.text("link.prefix", link.prefix);
  keys.chosen("link.check", link.check, {"none", "sum8", "xor", "crc16"});
  if (link.check == SentenceCheck::crc16) {
    link.crc.polynomial = crc_number(file, "link.crc.polynomial", {});
    if (link.crc.polynomial % 2 == 0)
      file.reject("link.crc.polynomial", "an odd number: the term 1 is in every polynomial");
    link.crc.initial = crc_number(file, "link.crc.initial", 0);
    link.crc.final_xor = crc_number(file, "link.crc.final_xor", 0);
    keys.flag("link.crc.reflect_input", link.crc.reflect_input);
    keys.flag("link.crc.reflect_output", link.crc.reflect_output);
  }
  keys.text("link.check_mark", link.check_mark);
  read_link_times(keys, link, "link.reply_timeout_s");
}

std::string key_of(TableOperation operation) {
  return operation == TableOperation::setup ? "prepare" : to_string(operation);
}

Result<std::string> body_of(const DialectLink& link, const std::string& frame) {
  const auto wrong = [&](const std::string& what) {
    return device_error(fmt::format("answer '{}': {}", visible(frame), what));
  };
  if (!frame.starts_with(link.prefix)) return wrong("expected it to begin with " + link.prefix);
  std::string body = frame.substr(link.prefix.size());
  if (link.check == SentenceCheck::none) return body;
  const std::size_t digit_count = link.check == SentenceCheck::crc16 ? 4 : 2;
  const std::size_t tail = link.check_mark.size() + digit_count;
  if (body.size() < tail || body.substr(body.size() - tail, link.check_mark.size()) != link.check_mark)
    return wrong("no checksum");
  const std::string digits = body.substr(body.size() - digit_count);
  body.resize(body.size() - tail);
  const std::string expected = check_digits(body, link.check, link.crc);
  if (digits != expected) return wrong("checksum " + digits + ", expected " + expected);
  return body;
}

std::string frame_of(const DialectLink& link, const std::string& body) {
  const bool checked = link.check != SentenceCheck::none;
  return link.prefix + body + (checked ? link.check_mark + check_digits(body, link.check, link.crc) : "");
}

bool DialectStatus::reports(DriveBit bit) const {
  if (by_bits) return mask[index(bit)] != 0;
  return std::ranges::any_of(
      codes, [bit](const auto& code) { return std::ranges::find(code.second, bit) != code.second.end(); });
}

Result<Dialect> read_dialect(const std::string& path) {
  TRY(expect_file(path, FileKind::dialect));
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return dialect_from(file);
}

Result<Dialect> parse_dialect(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return dialect_from(file);
}

std::string caution_of(const Dialect& dialect) {
  if (!dialect.can_switch_off)
    return "switch_off = false: its drives stay on after every run, with nobody to watch them";
  if (dialect.status.reports(DriveBit::enabled)) return "";
  return "its status does not tell whether a drive is on: that they are off is what was commanded, not what was read";
}

AxisReading flags_of(const DialectStatus& status, const std::string& word) {
  AxisReading result;
  const auto bits = parse_integer<std::uint32_t>(word, status.by_bits ? status.base : 10);
  result.raw = bits.value_or(0);
  const auto code = status.codes.find(word);
  result.known = status.by_bits ? bits.has_value() : code != status.codes.end();
  for (const DriveBit bit : all_drive_bits) {
    const std::size_t at = index(bit);
    if (!status.reports(bit)) continue;
    if (!result.known)
      result.flags[at] = bit == DriveBit::moving;
    else if (status.by_bits)
      result.flags[at] = ((result.raw & status.mask[at]) != 0) != status.active_low[at];
    else
      result.flags[at] = std::ranges::find(code->second, bit) != code->second.end();
  }
  return result;
}

// ---- sentences of a move ----

Asked asked_by(const std::string& name, Axis addressed) {
  std::string_view quantity = name;
  const Axis axis = take_axis(quantity).value_or(addressed);
  return {enum_from<MoveQuantity>(quantity), quantity == "status", axis};
}

std::string sentence_number(double value, int decimals, bool plus) {
  const std::string number = plus ? fmt::format("{:+.{}f}", value, decimals) : fmt::format("{:.{}f}", value, decimals);
  // "-0.0000" confuses some parsers.
  const bool zero = number.find_first_not_of("-0.") == std::string::npos;
  return zero && number[0] == '-' ? (plus ? "+" : "") + number.substr(1) : number;
}

namespace {

double grain(int decimals) { return std::pow(10.0, -decimals); }

// Returns an angle in [0, turn), rounded to so many decimals.
double on_circle(double units, double turn, int decimals) {
  const double remainder = grain(decimals) * std::round((units - turn * std::floor(units / turn)) / grain(decimals));
  return remainder >= turn ? 0.0 : remainder;
}

// REQUIRES: the placeholder is a quantity.
double units_of(const Dialect& dialect, const Asked& asked, const Moves& moves) {
  const DialectAxis& scale = dialect.of(asked.axis);
  const double units = scale.units_of(*asked.number, moves[index(asked.axis)]);
  const bool of_circle = scale.shorter_way && asked.number == MoveQuantity::position;
  return of_circle ? on_circle(units, scale.units_per_degree * scale.modulo_deg, dialect.decimals) : units;
}

}  // namespace

std::string filled(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, const Moves& moves) {
  return sentence.fill([&](const std::string& name) -> std::string {
    if (name == "axis") return dialect.of(axis).name;
    const Asked asked = asked_by(name, axis);
    return asked.number ? sentence_number(units_of(dialect, asked, moves), dialect.decimals, dialect.plus) : "";
  });
}

Status check_sentences(const Dialect& dialect, Axis axis, const Moves& moves) {
  for (const Exchange& exchange : dialect.of(TableOperation::move).exchanges) {
    const std::string body = filled(dialect, exchange.send, axis, moves);
    const auto cannot = [&](const std::string& expected) {
      return input_error("the device cannot take '" + visible(body) + "': expected " + expected);
    };
    if (!exchange.send.match(body)) return cannot("numbers that fit '" + exchange.send.text() + "'");
    for (const std::string& name : exchange.send.names()) {
      const Asked asked = asked_by(name, axis);
      if (asked.axis != axis || (asked.number != MoveQuantity::rate && asked.number != MoveQuantity::acceleration))
        continue;
      const double units = units_of(dialect, asked, moves);
      if (is_told_coarsely(parse_number(sentence_number(units, dialect.decimals)).value_or(0.0), units))
        return cannot(fmt::format("number.decimals or a scale with which the {} {} is told to 5 %",
                                  to_string(*asked.number), format_number(units)));
    }
  }
  return {};
}

Status check_move(const Dialect& dialect, Axis axis, const Moves& moves, double tolerance_deg) {
  TRY(check_sentences(dialect, axis, moves));
  const double scale = dialect.of(axis).units_per_degree;
  for (const Exchange& exchange : dialect.of(TableOperation::move).exchanges) {
    for (const std::string& name : exchange.send.names()) {
      const Asked asked = asked_by(name, axis);
      if (asked.axis != axis || (asked.number != MoveQuantity::position && asked.number != MoveQuantity::distance))
        continue;
      const double units = units_of(dialect, asked, moves);
      const double told = parse_number(sentence_number(units, dialect.decimals)).value_or(0.0);
      if (!(std::abs(told - units) <= tolerance_deg * scale))
        return input_error("number.decimals = " + std::to_string(dialect.decimals) + ": tells " + format_number(units) +
                           " as " + format_number(told) + ": expected an angle told to motion.position_tolerance_deg");
    }
  }
  for (const Exchange& exchange : dialect.of(TableOperation::status).exchanges) {
    for (const std::string& name : exchange.expect ? exchange.expect->names() : std::vector<std::string>()) {
      const Asked asked = asked_by(name, axis);
      const auto width = int(exchange.expect->width_of(name));
      if (asked.number != MoveQuantity::position || asked.axis != axis || width == 0) continue;
      const DialectAxis& circle = dialect.of(axis);
      const double units = circle.modulo_deg > 0.0 ? circle.modulo_deg * scale : units_of(dialect, asked, moves);
      const int whole = int(sentence_number(units, 0, dialect.plus).size());
      const int decimals = std::max(0, width - whole - 1);  // upper limit
      if (whole > width || !(0.5 * grain(decimals) <= tolerance_deg * scale))
        return input_error("{" + name + ":" + std::to_string(width) + "} in an answer to status cannot show " +
                           format_number(units) + " to motion.position_tolerance_deg: expected more columns");
    }
  }
  return {};
}

// ---- explain(): each operation, sentence by sentence ----

namespace {

constexpr std::size_t whole = std::string::npos;

std::string quantities_of(const Dialect& dialect, const SentenceTemplate& sentence, Axis axis, bool told) {
  std::string text;
  for (const std::string& name : sentence.names())
    if (const Asked asked = asked_by(name, axis); asked.number)
      text += fmt::format("{}{}: {}", text.empty() ? "" : "; ", name,
                          scale_text(dialect.of(asked.axis), *asked.number, told));
  return text;
}

std::string answer_of(const Dialect& dialect, const Exchange& exchange) {
  const DialectLink& link = dialect.link;
  std::string text = link.echo ? "its echo, " : "";
  if (exchange.expect) {
    const std::string digits = link.check == SentenceCheck::crc16 ? "CCCC" : "CC";
    const std::string open = link.prefix + exchange.expect->text() + link.check_mark + digits;
    const bool fixed = exchange.expect->names().empty() || link.check == SentenceCheck::none;
    text += visible((fixed ? frame_of(link, exchange.expect->text()) : open) + link.terminator_in, whole);
  } else {
    text += "nothing";
  }
  return text + (link.prompt.empty() ? "" : ", then '" + visible(link.prompt) + "'");
}

void explain_steps(const Dialect& dialect, TableOperation operation, const std::string& name,
                   std::vector<TableRow>& rows) {
  const DialectSteps& steps = dialect.of(operation);
  const bool once = !steps.each_axis && operation != TableOperation::move;
  for (const Axis axis : axes_for(once)) {
    Moves moves{};
    moves[index(axis)] = shown_move;
    for (std::size_t i = 0; i < steps.exchanges.size(); ++i) {
      const Exchange& exchange = steps.exchanges[i];
      const std::string key = fmt::format("{}.{}", key_of(operation), i + 1);
      std::string says = quantities_of(dialect, exchange.send, axis, true);
      if (says.empty() && exchange.expect) says = quantities_of(dialect, *exchange.expect, axis, false);
      rows.push_back(
          {name, once ? "table" : to_string(axis),
           visible(frame_of(dialect.link, filled(dialect, exchange.send, axis, moves)) + dialect.link.terminator_out,
                   whole),
           says, answer_of(dialect, exchange), source_of(dialect, key)});
    }
  }
}

void explain_flags(const Dialect& dialect, std::vector<TableRow>& rows) {
  const DialectStatus& status = dialect.status;
  for (const DriveBit bit : all_drive_bits) {
    const std::size_t at = index(bit);
    if (!status.by_bits || status.mask[at] == 0) continue;
    const std::string flag = to_string(bit);
    const bool several = (status.mask[at] & (status.mask[at] - 1)) != 0;
    rows.push_back({"status", "each", fmt::format("  its status word, base {}", status.base),
                    fmt::format("{}: mask 0x{:08X}{} {}", flag, status.mask[at], several ? ", one of it" : ",",
                                status.active_low[at] ? "clear" : "set"),
                    "", source_of(dialect, "status.bit." + flag)});
  }
  for (const auto& [code, flags] : status.codes) {
    std::string names;
    for (const DriveBit flag : flags) names += (names.empty() ? "" : ", ") + std::string(to_string(flag));
    rows.push_back({"status", "each", "  its status word", visible(code) + ": " + (names.empty() ? "none" : names), "",
                    source_of(dialect, "status.code." + code)});
  }
}

}  // namespace

std::vector<TableRow> explain(const Dialect& dialect) {
  std::vector<TableRow> rows;
  for (const auto& [operation, name] : shown_operations) {
    explain_steps(dialect, operation, name, rows);
    if (operation == TableOperation::status) explain_flags(dialect, rows);
  }
  return rows;
}

}  // namespace turncal
