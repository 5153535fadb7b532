// A prefix in front of every line of a stream while this lives: "[dry run] ", so that no line of a simulation passes for a real one.
//
//   const LinePrefix marked(out, "[dry run] ");
//   out << "one\n\ntwo\n";   // "[dry run] one\n[dry run]\n[dry run] two\n"
//
// A line begins after '\n', and after '\r', with which a line is drawn again in place. Empty prefix: the stream is as it was.
// Within another's life the outer prefix stands first. One thread at a time, as for the stream itself.
#pragma once

#include <ostream>
#include <streambuf>
#include <string>

namespace turncal {

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
