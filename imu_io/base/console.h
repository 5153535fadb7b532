// Standard output and error of a program that may hold a table: nobody who does not read them (Ctrl-S on a terminal, a pipe that is full) holds
// it up.
//
//   Console out(std::cout, STDOUT_FILENO);         // what is printed to std::cout goes through it while it lives
//   { const Unhindered now; std::cout << line; }   // waits for nobody; what does not fit is kept, and printed when it does
//
// Outside of an Unhindered's life printing waits, as usual; after one for `last_wait_s` at most, together, since what is printed then is the end of a
// run, and may be nobody's. What is kept has a limit; what is beyond it is left out, and said ("[3 lines were not printed]").
// Thread-safe by itself; a stream's format flags are not.
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
  ~Console() override;  // prints what is left; the stream is as it was
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

 private:
  int_type overflow(int_type c) override;
  std::streamsize xsputn(const char* text, std::streamsize size) override;
  int sync() override;
  void keep(std::string_view text);
  bool print();  // false: it cannot be written
  bool waits_for_room();

  std::ostream& stream_;
  std::streambuf* was_;
  int descriptor_, own_ = -1;  // own_: the same terminal or pipe, not waiting; -1: none
  std::mutex mutex_;
  std::string kept_;
  std::size_t left_out_ = 0;  // lines
  bool in_left_out_ = false;  // the line that is being printed is
  bool line_wise_ = false, failed_ = false;
  double waited_s_ = 0.0;
};

// A prefix in front of every line of a stream while this lives: "[dry run] ", so that no line of a simulation passes for a real one.
//
//   const LinePrefix marked(out, "[dry run] ");
//   out << "one\n\ntwo\n";   // "[dry run] one\n[dry run]\n[dry run] two\n"
//
// A line begins after '\n', and after '\r', with which a line is drawn again in place. Empty prefix: the stream is as it was.
// Within another's life the outer prefix stands first. One thread at a time, as for the stream itself.
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
