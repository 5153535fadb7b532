#include "imu_io/base/console.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string_view>
#include <utility>

#include "imu_io/base/clock.h"

namespace turncal {
namespace {

constexpr std::size_t piece = 256;    // bytes of one write to a blocking descriptor: poll() promises room for no more
constexpr std::size_t enough = 4096;  // bytes that are written even without a line end or a flush

// Opens the same terminal or pipe again as non-blocking. The flags of the given descriptor are shared with other processes, so they stay.
int not_waiting(int descriptor) {
  struct stat what {};
  if (::fstat(descriptor, &what) != 0 || !(S_ISFIFO(what.st_mode) || ::isatty(descriptor) == 1)) return -1;
  return ::open(("/proc/self/fd/" + std::to_string(descriptor)).c_str(), O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
}

}  // namespace

Console::Console(std::ostream& stream, int descriptor)
    : stream_(stream),
      was_(stream.rdbuf(this)),
      descriptor_(descriptor),
      own_(not_waiting(descriptor)),
      line_wise_(::isatty(descriptor) == 1) {}

Console::~Console() {
  sync();
  stream_.rdbuf(was_);
  if (own_ >= 0) ::close(own_);
}

Console::int_type Console::overflow(int_type c) {
  if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
  const char letter = traits_type::to_char_type(c);
  return xsputn(&letter, 1) == 1 ? c : traits_type::eof();
}

std::streamsize Console::xsputn(const char* text, std::streamsize size) {
  const std::lock_guard lock(mutex_);
  const std::string_view all(text, std::size_t(size));
  keep(all);
  const bool due = kept_.size() >= enough || (line_wise_ && all.find('\n') != std::string_view::npos);
  return !due || print() ? size : 0;
}

int Console::sync() {
  const std::lock_guard lock(mutex_);
  return print() ? 0 : -1;
}

// Only whole lines are dropped.
void Console::keep(std::string_view text) {
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size() - 1) + 1;
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end);
    if (!in_left_out_ && kept_.size() + line.size() > most_kept && (kept_.empty() || kept_.back() == '\n'))
      in_left_out_ = true;
    if (!in_left_out_) {
      if (left_out_ > 0 && (kept_.empty() || kept_.back() == '\n')) {
        kept_ += "[" + std::to_string(left_out_) + (left_out_ == 1 ? " line was" : " lines were") + " not printed]\n";
        left_out_ = 0;
      }
      kept_ += line;
    } else if (line.back() == '\n') {
      ++left_out_;
      in_left_out_ = false;
    }
  }
}

bool Console::print() {
  const int to = own_ >= 0 ? own_ : descriptor_;
  std::size_t done = 0;
  while (done < kept_.size() && !failed_) {
    if (!waits_for_room()) break;
    const std::size_t size = own_ >= 0 ? kept_.size() - done : std::min(kept_.size() - done, piece);
    const ssize_t written = ::write(to, kept_.data() + done, size);
    if (written >= 0)
      done += std::size_t(written);
    else if (errno != EAGAIN && errno != EINTR)
      failed_ = true;
  }
  kept_.erase(0, done);
  if (failed_) kept_.clear();
  return !failed_;
}

// Waits until something can be written; false once the time limit is used up.
bool Console::waits_for_room() {
  const int to = own_ >= 0 ? own_ : descriptor_;
  const bool limited = Unhindered::ever();
  const double limit_s = Unhindered::now() ? 0.0 : limited ? std::max(0.0, last_wait_s - waited_s_) : 1e9;
  const double began_s = monotonic_s();
  int ready = 0;
  do {
    const double left_s = limit_s - (monotonic_s() - began_s);
    ready = wait_ready(to, POLLOUT, limited ? int(1000.0 * std::max(0.0, left_s)) : -1);
  } while (ready < 0 && errno == EINTR);
  if (!Unhindered::now()) waited_s_ += limited ? monotonic_s() - began_s : 0.0;
  return ready > 0;
}

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
    // An empty line gets no trailing blank.
    const std::string_view head(prefix_.data(), prefix_.size() - (byte == '\n' && prefix_.back() == ' ' ? 1 : 0));
    const auto size = static_cast<std::streamsize>(head.size());
    if (to_->sputn(head.data(), size) != size) return traits_type::eof();
  }
  at_start_ = byte == '\n' || byte == '\r';
  return to_->sputc(byte);
}

int LinePrefix::sync() { return to_->pubsync(); }

}  // namespace turncal
