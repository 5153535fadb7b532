#include "orchestrator/figures/report_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "calib/model/parameters.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/watch/progress.h"

namespace turncal {

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

std::string clock_time(double seconds) { return std::isfinite(seconds) ? format_duration(seconds) : "-"; }

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
