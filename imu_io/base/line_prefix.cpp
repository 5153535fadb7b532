#include "imu_io/base/line_prefix.h"

#include <string_view>
#include <utility>

namespace turncal {

LinePrefix::LinePrefix(std::ostream& out, std::string prefix)
    : out_(out), to_(out.rdbuf()), prefix_(std::move(prefix)) {
  if (!prefix_.empty()) out_.std::basic_ios<char>::rdbuf(this);
}

LinePrefix::~LinePrefix() {
  if (prefix_.empty()) return;
  const std::ios::iostate state = out_.rdstate();
  out_.std::basic_ios<char>::rdbuf(to_);  // clears the state
  out_.setstate(state);
}

LinePrefix::int_type LinePrefix::overflow(int_type c) {
  if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
  const char byte = traits_type::to_char_type(c);
  if (at_start_ && byte != '\r') {
    // No blank at the end of an empty line.
    const std::string_view head(prefix_.data(), prefix_.size() - (byte == '\n' && prefix_.back() == ' ' ? 1 : 0));
    const auto size = static_cast<std::streamsize>(head.size());
    if (to_->sputn(head.data(), size) != size) return traits_type::eof();
  }
  at_start_ = byte == '\n' || byte == '\r';
  return to_->sputc(byte);
}

int LinePrefix::sync() { return to_->pubsync(); }

}  // namespace turncal
