#include "orchestrator/station/number_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <utility>

#include "calib/model/parameters.h"
#include "imu_io/base/text.h"

namespace turncal {

std::string quantity(double value, double sigma, std::string_view unit) {
  return plus_minus(value, sigma, Alphabet::typographic) + " " + unit_text(unit);
}

const char* parameter_unit(std::string_view key, IncrementKind gyro_increment) {
  if (key.starts_with('N')) return "deg/h";
  if (key.starts_with('A')) return "g";
  return key.starts_with('n') && gyro_increment == IncrementKind::pulses ? "arcsec/pulse" : "-";
}

namespace {

struct Named {
  std::string_view key, name, unit;
};
constexpr Named named_quantities[] = {{"residual", "normalised residual", ""},
                                      {"temperature", "highest temperature", "C"},
                                      {"temperature_c.min", "lowest temperature", "C"},
                                      {"temperature_c.max", "highest temperature", "C"},
                                      {"hours", "hours on the table", "h"},
                                      {"clock_ppm", "clock of the unit", "ppm"}};
constexpr std::string_view of_sigma = "sigma.";

bool is_parameter(std::string_view key) { return std::ranges::find(parameter_keys, key) != parameter_keys.end(); }

}  // namespace

std::string quantity_name(std::string_view key) {
  if (key.starts_with(of_sigma)) return "sigma of " + quantity_name(key.substr(of_sigma.size()));
  if (const auto* const at = std::ranges::find(named_quantities, key, &Named::key); at != std::end(named_quantities))
    return std::string(at->name);
  if (!is_parameter(key)) return std::string(key);
  const bool gyro = key[0] == 'N' || key[0] == 'n';
  const auto axis = [key](std::size_t at) { return std::string(1, char('x' + key[at] - '1')); };
  const std::string sensor = gyro ? "gyro " : "accelerometer ";
  if (key[1] == '0') return sensor + axis(2) + " bias";
  return sensor + axis(1) + (key[1] == key[2] ? " scale factor" : " towards " + axis(2));
}

std::string quantity_unit(std::string_view key) {
  if (key.starts_with(of_sigma)) return quantity_unit(key.substr(of_sigma.size()));
  if (const auto* const at = std::ranges::find(named_quantities, key, &Named::key); at != std::end(named_quantities))
    return std::string(at->unit);
  const bool has_unit = is_parameter(key) && (key[0] == 'N' || key[0] == 'A');
  return has_unit ? parameter_unit(key, IncrementKind::physical) : "";
}

std::string unit_text(std::string_view unit) {
  std::string result;
  for (std::size_t at = 0; at < unit.size();) {
    const bool begins = at == 0 || unit[at - 1] == '/' || unit[at - 1] == ' ';
    const auto take = [&](std::string_view word, std::string_view by) {
      if (!unit.substr(at).starts_with(word)) return false;
      result += by;
      at += word.size();
      return true;
    };
    if (begins &&
        (take("ug", "µg") || take("arcsec", "″") || take("deg", "°") || ((at > 0 || unit == "C") && take("C", "°C"))))
      continue;
    if (take("^2", "²") || take("^3", "³") || take("sqrt(h)", "√h") || take("sqrt(Hz)", "√Hz")) continue;
    result += unit[at++];
  }
  return result;
}

DisplayUnit page_unit(std::string_view unit) {
  return unit == "g" ? DisplayUnit{1e6, "µg"} : DisplayUnit{1.0, unit == "-" ? "" : unit_text(unit)};
}

DisplayUnit error_unit(std::string_view key, std::string_view unit, double scale) {
  if (key.size() != 3 || (key[0] != 'n' && key[0] != 'a')) return page_unit(unit);
  return {1e6 / scale, key[1] == key[2] ? "ppm" : "µrad"};
}

std::string in_words(std::string_view word) {
  std::string words(word);
  std::ranges::replace(words, '_', ' ');
  return words;
}

namespace {

struct Glyph {
  std::size_t bytes = 1, columns = 1;
};

Glyph first_glyph(std::string_view text) {
  static constexpr std::pair<std::uint32_t, std::uint32_t> wide[] = {
      {0x1100, 0x115F}, {0x2E80, 0xA4CF}, {0xAC00, 0xD7A3}, {0xF900, 0xFAFF},
      {0xFE30, 0xFE6F}, {0xFF00, 0xFF60}, {0xFFE0, 0xFFE6}, {0x1F300, 0x3FFFD}};
  std::uint32_t code = 0;
  const std::size_t bytes = std::max<std::size_t>(1, utf8_character(text, &code));
  const bool two =
      std::ranges::any_of(wide, [code](auto range) { return code >= range.first && code <= range.second; });
  return {bytes, two ? std::size_t{2} : std::size_t{1}};
}

// Returns the bytes of the longest prefix that takes at most `columns`. breaks: it ends at a blank or after a wide character, if possible.
std::size_t beginning(std::string_view text, std::size_t columns, bool breaks) {
  std::size_t at = 0, good = 0;
  for (std::size_t used = 0; at < text.size();) {
    const Glyph glyph = first_glyph(text.substr(at));
    if (text[at] == ' ') good = at;
    used += glyph.columns;
    if (used > columns) return breaks && good > 0 ? good : at;
    at += glyph.bytes;
    if (glyph.columns == 2) good = at;
  }
  return at;
}

}  // namespace

std::size_t columns_of(std::string_view text) {
  std::size_t columns = 0;
  for (; !text.empty(); text.remove_prefix(first_glyph(text).bytes)) columns += first_glyph(text).columns;
  return columns;
}

std::vector<std::string> wrap(std::string_view text, std::size_t columns) {
  std::vector<std::string> lines;
  do {
    std::string_view rest = trimmed(next_line(text));
    do {
      lines.emplace_back(rest.substr(0, beginning(rest, columns, true)));
      rest = trimmed(rest.substr(lines.back().size()));
    } while (!rest.empty());
  } while (!text.empty());
  return lines;
}

std::string shorten(std::string_view text, std::size_t columns) {
  if (beginning(text, columns, false) == text.size()) return std::string(text);
  return std::string(text.substr(0, beginning(text, columns - 3, false))) + "...";
}

// ---- texts ----

std::string html_escape(std::string_view text) {
  static constexpr std::pair<char, std::string_view> escapes[] = {{'&', "&amp;"},  {'<', "&lt;"},   {'>', "&gt;"},
                                                                  {'"', "&quot;"}, {'\'', "&#39;"}, {'\x7f', " "}};
  std::string result;
  while (!text.empty()) {
    const std::size_t length = utf8_character(text);
    const auto* const escape = std::ranges::find(escapes, text[0], &std::pair<char, std::string_view>::first);
    result += length == 0                                  ? "?"
              : escape != std::end(escapes)                ? escape->second
              : static_cast<unsigned char>(text[0]) < 0x20 ? " "
                                                           : text.substr(0, length);
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return result;
}

std::string url_escape(std::string_view path) {
  std::string result;
  for (const char c : path)
    result +=
        std::isalnum(static_cast<unsigned char>(c)) != 0 || std::string_view("-._~/:").find(c) != std::string_view::npos
            ? std::string(1, c)
            : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  return result;
}

std::string ratio(double value) {
  return std::isfinite(value) ? value < 100.0 ? with_decimals(value, 3) : significant(value, 4) : "-";
}

std::string percent_change(double before, double after) {
  if (!std::isfinite(before) || !std::isfinite(after) || before <= 0.0) return "-";
  const double percent = 100.0 * (after / before - 1.0);
  const std::string text = with_decimals(percent, std::abs(percent) < 9.95 && std::abs(percent) >= 0.05 ? 1 : 0);
  return (percent > 0.0 && text != "0" ? "+" : "") + text + " %";
}

std::string signed_number(double value, int decimals) {
  if (!std::isfinite(value)) return "-";
  const std::string text = with_decimals(value, decimals);
  return text[0] == '-' ? text : "+" + text;
}

DisplayUnit velocity_unit(double largest_mps) {
  if (largest_mps < 1e-4) return {1e6, "µm/s"};
  return largest_mps < 2.0 ? DisplayUnit{1e3, "mm/s"} : DisplayUnit{1.0, "m/s"};
}
DisplayUnit acceleration_unit(double largest_mps2) {
  constexpr double g = standard_gravity_mps2;
  if (largest_mps2 < 3e-3 * g) return {1e6 / g, "µg"};
  return largest_mps2 < 1.0 * g ? DisplayUnit{1e3 / g, "mg"} : DisplayUnit{1.0 / g, "g"};
}
DisplayUnit rate_unit(double largest_radps) {
  return largest_radps < 300.0 * radps_per_degph ? DisplayUnit{1.0 / radps_per_degph, "°/h"}
                                                 : DisplayUnit{1.0 / rad_per_deg, "°/s"};
}
DisplayUnit angle_unit(double largest_rad) {
  return largest_rad < 2e-3 ? DisplayUnit{1.0 / rad_per_arcsec, "″"} : DisplayUnit{1e3, "mrad"};
}

std::string join(const std::vector<std::string>& parts, std::string_view separator) {
  return fmt::format("{}", fmt::join(parts, separator));
}

}  // namespace turncal
