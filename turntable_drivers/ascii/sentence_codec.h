// The codec for sentences (turntable_drivers/table/table_codec.h): a table with an ASCII dialect, described by a Dialect, over a serial
// line or TCP:
//
// - Frame: prefix + body + (check_mark + check digits) + terminator. An answer with a wrong prefix, a wrong or missing check, or extra
//   characters after it is an error. An echo must repeat what was sent.
// - An answer must match its template, and a number must be valid; otherwise it is an error. An unknown status means "not arrived".
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/table_codec.h"

namespace turncal {

// Sentences and answers on a line to any device, by these rules.
class SentenceFraming {
 public:
  explicit SentenceFraming(const DialectLink& link) : link_(link) {}
  std::string framed(const std::string& body) const { return frame_of(link_, body) + link_.terminator_out; }
  // lines: number of lines of the answer; 0: no answer is expected.
  std::optional<std::size_t> reply_end(const std::string& heard, int lines, bool at_once) const;
  // Returns the lines of an answer without their frames, separated by \n. After an error the line must be drained.
  Result<std::string> answer(const std::string& sent_body, const std::string& reply, const std::string& heard,
                             int lines) const;
  Judgement garbled(const std::string& what) const { return turncal::garbled(link_.address + ": " + what); }
  const std::string& end_of_answer() const { return link_.prompt.empty() ? link_.terminator_in : link_.prompt; }

 private:
  Result<std::string> bodies_of(const std::string& frames, int lines) const;
  DialectLink link_;
};

std::unique_ptr<TableCodec> codec_of(const Dialect& dialect);

}  // namespace turncal
