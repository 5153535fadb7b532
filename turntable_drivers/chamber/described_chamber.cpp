#include "turntable_drivers/chamber/described_chamber.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "imu_io/base/text.h"

namespace turncal {

const std::array<const char*, chamber_item_count> chamber_keys = {"read.actual", "read.set_point", "read.on",
                                                                  "read.door",   "read.alarm",     "write.set_point",
                                                                  "write.ramp",  "write.on",       "write.off"};

Status check_set_point(const ChamberLimits& limits, double temperature_c, double ramp_c_per_min) {
  if (!(temperature_c >= limits.low_c && temperature_c <= limits.high_c))
    return input_error("a set point of {} C: expected {} to {} C, the chamber's limits", format_number(temperature_c),
                       format_number(limits.low_c), format_number(limits.high_c));
  if (!(ramp_c_per_min > 0.0 && ramp_c_per_min <= limits.ramp_c_per_min))
    return input_error("a ramp of {} C/min: expected at most {}, the chamber's limit", format_number(ramp_c_per_min),
                       format_number(limits.ramp_c_per_min));
  return {};
}

bool is_believable(const ChamberLimits& limits, double actual_c) {
  return actual_c >= limits.low_c - sensor_margin_c && actual_c <= limits.high_c + sensor_margin_c;
}

namespace {

constexpr NumberRange chamber_scale{1e-3, 1e6};

// Reads "ADDRESS TYPE" of a number.
RegisterField register_field(KeyValueFile& file, const std::string& key) {
  const std::string text = file.text(key);
  const auto words = split_words(text);
  const auto address = words.size() == 2 ? parse_whole<int>(words[0]) : std::nullopt;
  const auto type = words.size() == 2 ? enum_from<WordType>(words[1]) : std::nullopt;
  const bool good = address && type && *address >= 0 && *address + register_count(*type) <= 65536;
  if (!good && !text.empty()) file.reject(key, "ADDRESS TYPE, the type " + one_of(words.back(), words_of<WordType>()));
  return good ? RegisterField{*address, *type} : RegisterField{};
}

WriteList command_list(KeyValueFile& file, const std::string& key, const WordLayout& layout) {
  WriteList list;
  for (const std::string& text : file.list(key)) {
    const auto step = parse_write_step(trimmed(text));
    const bool good =
        step && !step->operands.empty() && std::ranges::all_of(step->operands, [&](const WriteOperand& operand) {
          const bool whole = is_floating(operand.type) || operand.constant == std::round(operand.constant);
          return operand.kind == WriteOperand::Kind::constant && whole &&
                 encode_words(operand.constant, operand.type, layout);
        });
    if (!good) file.reject(key, "steps 'ADDRESS TYPE NUMBER', separated by commas; wrong is " + quoted(text));
    if (good) list.push_back(*step);
  }
  return list;
}

// `values`: required number of {value}.
SentenceTemplate sentence_of(KeyValueFile& file, const std::string& key, std::ptrdiff_t values) {
  const std::string text = file.text(key);
  const auto sentence = SentenceTemplate::parse(text);
  std::vector<std::string> names;
  if (sentence) names = sentence->names();
  const auto others = std::ranges::count_if(names, [](const auto& name) { return name != "value" && name != "*"; });
  const bool good = sentence && others == 0 && std::ranges::count(names, "value") == values &&
                    (values > 0 || names.empty() || key.ends_with(".expect"));
  if (!good && !text.empty())
    file.reject(key, values > 0 ? "a sentence with {value} once; {*} is anything" : "a sentence without {value}");
  return sentence.value_or(SentenceTemplate());
}

ChamberEntry read_entry(KeyValueFile& file, ChamberItem item, const ChamberDescription& chamber) {
  const std::string key = chamber_keys[index(item)];
  ChamberEntry entry;
  KeyTable keys(file);
  if (!is_flag(item) && !is_command(item)) keys.number(key + ".scale", entry.scale, chamber_scale);
  if (is_flag(item)) entry.true_values = file.list_or(key + ".values", {});
  if (chamber.by_registers()) {
    if (is_command(item)) {
      entry.writes = command_list(file, key, chamber.layout);
      if (entry.writes.empty()) file.reject(key, "steps ADDRESS TYPE NUMBER, one at least");
      return entry;
    }
    entry.field = register_field(file, key);
    if (!is_flag(item)) return entry;
    const std::string mask = file.text_or(key + ".mask", "0xFFFF");
    const auto number = parse_whole<std::uint16_t>(mask);
    if (!number || *number == 0) file.reject(key + ".mask", "bits of a register, such as 0x0001");
    entry.mask = number.value_or(0xFFFF);
    for (const std::string& value : entry.true_values)
      if (!parse_whole<std::uint16_t>(value)) file.reject(key + ".values", "numbers, what the mask leaves");
    return entry;
  }
  entry.send = sentence_of(file, key, is_read(item) || is_command(item) ? 0 : 1);
  if (is_read(item) || file.has(key + ".expect"))
    entry.expect = sentence_of(file, key + ".expect", is_read(item) ? 1 : 0);
  if (is_flag(item) && entry.true_values.empty()) file.list(key + ".values");  // reports the missing key
  return entry;
}

// Rejects an off command that equals the on command or cannot be told from it.
void reject_clashes(KeyValueFile& file, const ChamberDescription& chamber) {
  const auto &on = chamber.of(ChamberItem::switch_on), &off = chamber.of(ChamberItem::switch_off);
  if (!on || !off) return;
  const bool same = chamber.by_registers()
                        ? std::ranges::any_of(off->writes, [&](const auto& step) { return step == on->writes.back(); })
                        : on->send.text() == off->send.text();
  if (same) file.reject("write.off", "other words than those with which write.on ends");
  if (!(chamber.limits.grain_c <= 0.5))
    file.reject("write.set_point", "scales of read.actual, read.set_point and write.set_point that tell 0.5 C");
  const ChamberEntry& told = *chamber.of(ChamberItem::tell_set_point);
  for (const double c : {chamber.limits.low_c, chamber.limits.high_c})
    if (chamber.by_registers() && !encode_words(told.scale * c, told.field.type, chamber.layout))
      file.reject("write.set_point", "a type that holds limits.low_c and limits.high_c times its scale");
}

Result<ChamberDescription> chamber_from(KeyValueFile& file) {
  ChamberDescription chamber;
  KeyTable keys(file);
  read_device_description(file, chamber);
  chamber.limits.low_c = file.number("limits.low_c", between(-200.0, 300.0));
  chamber.limits.high_c = file.number("limits.high_c", between(-200.0, 300.0));
  chamber.limits.ramp_c_per_min = file.number("limits.ramp_c_per_min", between(0.01, 100.0));
  if (!(chamber.limits.low_c < chamber.limits.high_c)) file.reject("limits.low_c", "a number below limits.high_c");
  if (file.has("link.kind") && file.text("link.kind") == "rig") {
    chamber.commissioned = true;
    TRY(file.check_all_used());
    return chamber;
  }
  using enum ChamberDescription::Language;
  chamber.language = file.one_of("language", {"registers", "sentences"}) == "registers" ? registers : sentences;
  if (chamber.by_registers()) {
    read_modbus_link(file, chamber.modbus);
    // The gap shows a repeated reply before the next request, which it could answer.
    if (!chamber.modbus.header() && !file.has("link.gap_s")) chamber.modbus.gap_s = 0.05;
    keys.whole("link.unit", chamber.unit, 0, 255);
    keys.whole("read.function", chamber.read_function, 3, 4);
    chamber.write_function = file.one_of_or("write.function", "6", {"6", "16"}) == "16" ? 16 : 6;
    chamber.layout.high_word_first =
        file.one_of_or("words.order", "high_first", {"high_first", "low_first"}) == "high_first";
    keys.flag("words.swap_bytes", chamber.layout.swap_bytes);
  } else {
    read_dialect_link(file, chamber.ascii);
    keys.whole("number.decimals", chamber.decimals, 0, 6);
  }
  for (std::size_t i = 0; i < chamber.entries.size(); ++i) {
    const auto item = static_cast<ChamberItem>(i);
    const bool optional = item == ChamberItem::door || item == ChamberItem::alarm || item == ChamberItem::tell_ramp;
    if (!optional || file.has(chamber_keys[i])) chamber.entries[i] = read_entry(file, item, chamber);
  }
  TRY(file.check_all_used());
  const auto grain_of = [&](ChamberItem item) {
    const ChamberEntry& entry = *chamber.of(item);
    if (!chamber.by_registers()) return std::pow(10.0, -chamber.decimals) / entry.scale;
    return is_floating(entry.field.type) ? 1e-3 : 1.0 / entry.scale;
  };
  chamber.limits.grain_c = std::max(
      {grain_of(ChamberItem::actual), grain_of(ChamberItem::set_point), grain_of(ChamberItem::tell_set_point)});
  reject_clashes(file, chamber);
  TRY(file.status());
  return chamber;
}

}  // namespace

Result<ChamberDescription> read_chamber(const std::string& path) {
  KeyValueFile file = TRY(KeyValueFile::read(path));
  return chamber_from(file);
}

Result<ChamberDescription> parse_chamber(const std::string& text, const std::string& file_name) {
  KeyValueFile file = TRY(KeyValueFile::parse(text, file_name));
  return chamber_from(file);
}

bool decides_heat(std::string_view key) { return key.starts_with("write.") || key.starts_with("read.on"); }

bool says_true(const ChamberEntry& entry, const std::string& word) {
  if (entry.true_values.empty()) return word != "0";
  const auto number = parse_whole<std::uint16_t>(word);
  return std::ranges::any_of(entry.true_values, [&](const std::string& value) {
    return value == word || (number && parse_whole<std::uint16_t>(value) == number);
  });
}

std::vector<std::uint16_t> words_of(const ChamberDescription& chamber, const WriteStep& step) {
  std::vector<std::uint16_t> words;
  for (const WriteOperand& operand : step.operands) {
    const auto encoded = encode_words(operand.constant, operand.type, chamber.layout);
    words.insert(words.end(), encoded->span().begin(), encoded->span().end());
  }
  return words;
}

std::vector<TableRow> explain(const ChamberDescription& chamber) {
  std::vector<TableRow> rows;
  for (std::size_t i = 0; i < chamber.entries.size(); ++i) {
    const auto& entry = chamber.entries[i];
    const auto item = static_cast<ChamberItem>(i);
    if (!entry) continue;
    const std::string key = chamber_keys[i], unit = item == ChamberItem::tell_ramp ? "C/min" : "C";
    TableRow row{key.substr(0, key.find('.')), key.substr(key.find('.') + 1), "", "", "", source_of(chamber, key)};
    if (!is_flag(item) && !is_command(item)) row.says = format_number(entry->scale) + " per " + unit;
    if (is_flag(item))
      row.says =
          entry->true_values.empty() ? "true: not 0" : fmt::format("true: {}", fmt::join(entry->true_values, " or "));
    if (is_flag(item) && chamber.by_registers()) row.says += fmt::format(", mask 0x{:04X}", entry->mask);
    if (!chamber.by_registers()) {
      row.sent = entry->send.text();
      row.answer = entry->expect ? entry->expect->text() : "";
    } else if (!is_command(item)) {
      row.sent = fmt::format("unit {}, function {}, register {} {}", chamber.unit,
                             is_read(item) ? chamber.read_function : chamber.write_function,
                             register_text(entry->field.address), to_string(entry->field.type));
    }
    for (const WriteStep& step : entry->writes) {
      row.sent = fmt::format("unit {}, register {}", chamber.unit, register_text(step.address));
      row.says = fmt::format("{}", fmt::join(words_of(chamber, step), " "));
      rows.push_back(row);
    }
    if (entry->writes.empty()) rows.push_back(row);
  }
  return rows;
}

// ---- the driver ----

class ChamberCodec : public LineCodec {
 public:
  explicit ChamberCodec(const ChamberDescription& chamber)
      : chamber_(chamber), modbus_(chamber.modbus.header()), ascii_(chamber.ascii) {}

  TableRequest request(ChamberItem item, const std::string& body) {
    expect_ = chamber_.by_registers() ? std::nullopt : chamber_.of(item)->expect;
    TableRequest request;
    request.body = body;
    request.bytes = chamber_.by_registers() ? modbus_.framed(body) : ascii_.framed(body);
    return request;
  }
  std::optional<std::size_t> reply_end(const TableRequest& request, std::string& heard, bool at_once) const override {
    return chamber_.by_registers() ? modbus_.reply_end(request, heard, at_once)
                                   : ascii_.reply_end(heard, expect_ ? expect_->lines() : 0, at_once);
  }
  Judgement decode(const TableRequest& request, const std::string& reply, std::string& heard, AxisReading*) override {
    registers.clear();
    if (chamber_.by_registers()) return modbus_.judge(request, reply, heard, registers);
    const Result<std::string> said = ascii_.answer(request.body, reply, heard, expect_ ? expect_->lines() : 0);
    if (!said) return ascii_.garbled(said.error().message);
    const auto values = expect_ ? expect_->match(*said) : std::nullopt;
    // A wrong answer may belong to an earlier request, so the line is drained.
    if (expect_ && !values)
      return ascii_.garbled(fmt::format("answer '{}': expected '{}'", visible(*said), visible(expect_->text())));
    value = values && values->contains("value") ? values->at("value") : "";
    return {};
  }
  bool acknowledges(const TableRequest&, const std::string&) const override { return true; }
  bool has_unexpected(std::string& heard) const override {
    return chamber_.by_registers() ? modbus_.has_unexpected(heard) : !heard.empty();
  }

  std::vector<std::uint16_t> registers;  // from the last reply
  std::string value;

 private:
  const ChamberDescription& chamber_;
  ModbusFraming modbus_;
  SentenceFraming ascii_;
  std::optional<SentenceTemplate> expect_;
};

DescribedChamber::DescribedChamber(const ChamberDescription& description)
    : chamber_(description), codec_(std::make_unique<ChamberCodec>(chamber_)), line_(chamber_.link(), never_) {}

DescribedChamber::~DescribedChamber() {
  if (may_be_on_) static_cast<void>(off().ok());
}

std::string DescribedChamber::identity() const {
  return chamber_.name + " at " + chamber_.link().address +
         (chamber_.verified_on_hardware ? "" : ", not verified on hardware");
}

Error DescribedChamber::about(ChamberItem item, const std::string& what) const {
  return device_error("chamber " + chamber_.name + ": " + chamber_keys[index(item)] + ": " + what);
}

Status DescribedChamber::connect() {
  if (Status opened = line_.open(); !opened)
    return Error{opened.error().kind, "chamber " + chamber_.name + ": " + opened.error().message};
  TRY(status());
  return {};
}

Result<std::string> DescribedChamber::exchange(ChamberItem item, const std::string& body, bool again) {
  Judgement last;
  for (int i = 0; i <= (again ? chamber_.link().read_retries : 0); ++i) {
    if (i > 0 && !last.again) break;
    if (last.pause_s > 0.0) never_.pause(last.pause_s);
    last = line_.exchange(codec_->request(item, body), *codec_, nullptr);
    if (last.status) return codec_->value;
  }
  return Error{last.status.error().kind, about(item, last.status.error().message).message};
}

Result<std::string> DescribedChamber::read(ChamberItem item) {
  const ChamberEntry& entry = *chamber_.of(item);
  if (!chamber_.by_registers()) return exchange(item, entry.send.text(), true);
  const int count = register_count(entry.field.type);
  TRY(exchange(item, read_body(chamber_.unit, chamber_.read_function, entry.field.address, count), true));
  const double value = decode_words(codec_->registers, entry.field.type, chamber_.layout);
  if (!is_flag(item)) return format_number(value);
  const auto bits = unsigned(std::int64_t(value)) & entry.mask;
  return std::to_string(bits >> std::countr_zero(entry.mask));
}

Result<ChamberStatus> DescribedChamber::status() {
  ChamberStatus now;
  for (const ChamberItem item : {ChamberItem::actual, ChamberItem::set_point}) {
    const std::string word = TRY(read(item));
    const auto number = device_number(word);
    if (!number || !std::isfinite(*number)) return about(item, "'" + visible(word) + "': expected a number");
    (item == ChamberItem::actual ? now.actual_c : now.set_point_c) = *number / chamber_.of(item)->scale;
  }
  if (!is_believable(chamber_.limits, now.actual_c))
    return about(ChamberItem::actual,
                 format_number(now.actual_c) + " C: no air of this chamber is at that: is the sensor dead?");
  now.on = says_true(*chamber_.of(ChamberItem::on), TRY(read(ChamberItem::on)));
  for (const ChamberItem item : {ChamberItem::door, ChamberItem::alarm}) {
    if (!chamber_.of(item)) continue;
    (item == ChamberItem::door ? now.door_open : now.alarm) = says_true(*chamber_.of(item), TRY(read(item)));
  }
  if (!now.on) may_be_on_ = false;
  return now;
}

Status DescribedChamber::tell(ChamberItem item, double value) {
  const auto& entry = chamber_.of(item);
  if (!entry) return {};
  const double told = entry->scale * value;
  std::string body = chamber_.by_registers() ? "" : entry->send.fill([&](const std::string&) {
    return sentence_number(told, chamber_.decimals);
  });
  if (chamber_.by_registers()) {
    const auto words = encode_words(told, entry->field.type, chamber_.layout);
    if (!words) return about(item, format_number(told) + " does not fit its register");
    body =
        write_body(chamber_.unit, words->count > 1 ? 16 : chamber_.write_function, entry->field.address, words->span());
  }
  TRY(exchange(item, body, false));
  return {};
}

Status DescribedChamber::set(double temperature_c, double ramp_c_per_min) {
  TRY(check_set_point(chamber_.limits, temperature_c, ramp_c_per_min));
  TRY(tell(ChamberItem::tell_ramp, ramp_c_per_min));
  return tell(ChamberItem::tell_set_point, temperature_c);
}

Status DescribedChamber::switched(ChamberItem item) {
  if (item == ChamberItem::switch_on) {
    if (!chamber_.commissioned)
      return input_error(chamber_.file + ": the chamber is not commissioned: turncal commission --chamber comes first");
    may_be_on_ = true;
  } else if (!line_.is_open()) {
    TRY(line_.open());
  }
  const ChamberEntry& entry = *chamber_.of(item);
  if (!chamber_.by_registers()) TRY(exchange(item, entry.send.text(), false));
  for (const WriteStep& step : entry.writes) {
    const auto words = words_of(chamber_, step);
    const int function = words.size() > 1 ? 16 : chamber_.write_function;
    TRY(exchange(item, write_body(chamber_.unit, function, step.address, words), false));
  }
  return {};
}

}  // namespace turncal
