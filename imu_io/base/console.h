// Standard output and error of a program that may be holding a table. An output that nobody reads (Ctrl-S on a terminal, a full pipe) does not
// stop the program.
//
//   Console out(std::cout, STDOUT_FILENO);         // while it lives, std::cout prints through it
//   { const Unhindered now; std::cout << line; }   // never blocks; text that does not fit is buffered and printed later
//
// Without an Unhindered, printing blocks as usual. After the first one, blocking is limited to `last_wait_s` in total: what is printed then is the
// end of a run, and perhaps nobody reads it. The buffer has a limit; lines beyond it are dropped and counted ("[3 lines were not printed]").
// Thread-safe, except for the format flags of a stream.
#pragma once

#include <atomic>
#include <mutex>
#include <ostream>
#include <streambuf>
#include <string>

namespace turncal {

class Unhindered {
 public:
  Unhindered() { ++alive_, was_ = true; }
  ~Unhindered() { --alive_; }
  Unhindered(const Unhindered&) = delete;
  Unhindered& operator=(const Unhindered&) = delete;
  static bool now() { return alive_ > 0; }
  static bool ever() { return was_; }

 private:
  static inline std::atomic<int> alive_{0};
  static inline std::atomic<bool> was_{false};
};

class Console : private std::streambuf {
 public:
  static constexpr std::size_t most_kept = 1 << 20;  // bytes
  static constexpr double last_wait_s = 5.0;

  Console(std::ostream& stream, int descriptor);
  ~Console() override;  // prints the rest and restores the stream
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

 private:
  int_type overflow(int_type c) override;
  std::streamsize xsputn(const char* text, std::streamsize size) override;
  int sync() override;
  void keep(std::string_view text);
  bool print();  // false: the descriptor cannot be written
  bool waits_for_room();

  std::ostream& stream_;
  std::streambuf* was_;
  int descriptor_, own_ = -1;  // own_: the same terminal or pipe opened as non-blocking; -1: none
  std::mutex mutex_;
  std::string kept_;
  std::size_t left_out_ = 0;  // lines dropped and not reported yet
  bool in_left_out_ = false;  // the current line is being dropped
  bool line_wise_ = false, failed_ = false;
  double waited_s_ = 0.0;
};

// Puts a prefix before every line of a stream while it lives: "[dry run] ", so that no line of a simulation passes for a real one.
//
//   const LinePrefix marked(out, "[dry run] ");
//   out << "one\n\ntwo\n";   // "[dry run] one\n[dry run]\n[dry run] two\n"
//
// A line begins after '\n', and after '\r', which redraws a line in place. An empty prefix leaves the stream unchanged.
// Prefixes nest, the outer one first. Like the stream itself, it is not thread-safe.
class LinePrefix : private std::streambuf {
 public:
  LinePrefix(std::ostream& out, std::string prefix);
  ~LinePrefix() override;
  LinePrefix(const LinePrefix&) = delete;
  LinePrefix& operator=(const LinePrefix&) = delete;

 private:
  int_type overflow(int_type c) override;
  int sync() override;

  std::ostream& out_;
  std::streambuf* to_;
  std::string prefix_;
  bool at_start_ = true;
};

}  // namespace turncal
