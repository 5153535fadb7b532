#include "turntable_drivers/ascii/sentence.h"

#include <algorithm>
#include <cctype>
#include <span>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

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
      piece.width = static_cast<std::size_t>(*width);
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

int SentenceTemplate::lines() const { return 1 + static_cast<int>(std::count(text_.begin(), text_.end(), '\n')); }

bool SentenceTemplate::has(std::string_view name) const {
  for (const Piece& piece : pieces_) {
    if (piece.name == name) return true;
  }
  return false;
}

std::vector<std::string> SentenceTemplate::names() const {
  std::vector<std::string> result;
  for (const Piece& piece : pieces_) {
    if (!piece.name.empty()) result.push_back(piece.name);
  }
  return result;
}

std::size_t SentenceTemplate::width_of(std::string_view name) const {
  const auto place =
      std::find_if(pieces_.begin(), pieces_.end(), [&](const Piece& piece) { return piece.name == name; });
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

}  // namespace turncal
