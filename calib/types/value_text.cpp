#include "calib/types/value_text.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace turncal {

namespace {

std::string superscript(int number) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string result = number < 0 ? "⁻" : "";
  for (const char c : std::to_string(std::abs(number))) result += digits[c - '0'];
  return result;
}

// Decimal exponent of |value| once it is rounded to `digits` significant digits.
int exponent_of(double value, int digits) {
  const std::string text = fmt::format("{:.{}e}", value, digits - 1);
  return std::stoi(text.substr(text.find('e') + 1));
}

std::string with_exponent(double value, int digits, Alphabet alphabet) {
  const std::string text = fmt::format("{:.{}e}", value, digits - 1);
  if (alphabet == Alphabet::plain) return text;
  const std::size_t e = text.find('e');
  return text.substr(0, e) + "×10" + superscript(std::stoi(text.substr(e + 1)));
}

}  // namespace

std::string with_decimals(double value, int decimals) {
  if (!std::isfinite(value)) return "-";
  const std::string text = fmt::format("{:.{}f}", value, decimals);
  return text[0] == '-' && text.find_first_of("123456789") == std::string::npos ? text.substr(1) : text;
}

std::string counted(std::int64_t count, std::string_view noun) {
  const bool hisses = noun.ends_with("ch") || noun.ends_with("s");
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : hisses ? "es" : "s");
}

std::string significant(double value, int digits, Alphabet alphabet) {
  if (!std::isfinite(value)) return "-";
  if (value == 0.0) return "0";
  const int exponent = exponent_of(value, digits);
  if (exponent < -4 || exponent > 6) return with_exponent(value, digits, alphabet);
  return with_decimals(value, std::max(0, digits - 1 - exponent));
}

std::string value_with_sigma(double value, double sigma, Alphabet alphabet) {
  if (!std::isfinite(value)) return "-";
  if (!std::isfinite(sigma) || sigma <= 0.0) return significant(value, 6, alphabet);
  const int decimals = 1 - exponent_of(sigma, 2);
  if (decimals > 12) return significant(value, 6, alphabet);
  if (decimals >= 0) return with_decimals(value, decimals);
  const double place = std::pow(10.0, -decimals);
  return with_decimals(std::round(value / place) * place, 0);
}

std::string plus_minus(double value, double sigma, Alphabet alphabet) {
  const std::string text = value_with_sigma(value, sigma, alphabet);
  if (!std::isfinite(sigma) || sigma <= 0.0) return text;
  return text + (alphabet == Alphabet::plain ? " +- " : " ± ") + value_with_sigma(sigma, sigma, alphabet);
}

}  // namespace turncal
