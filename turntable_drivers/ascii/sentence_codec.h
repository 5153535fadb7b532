// The language of sentences (turntable_drivers/table/table_codec.h), for a table that speaks an ASCII dialect over a serial line or TCP, which
// a Dialect describes:
//
// - Frame: prefix + body + (check_mark + check digits) + terminator. An answer with a wrong prefix, a wrong or missing check, or more
//   characters after it than there should be is an error. An echo has to be what was sent.
// - An answer has to match its template, a number has to be a number, a status has to be known; else it is an error, or "not arrived".
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/table_codec.h"

namespace turncal {

// Sentences and answers on a line, whoever is behind it (the rules above).
class SentenceFraming {
 public:
  explicit SentenceFraming(const DialectLink& link) : link_(link) {}
  std::string framed(const std::string& body) const { return frame_of(link_, body) + link_.terminator_out; }
  // lines: of the answer; 0: none is expected.
  std::optional<std::size_t> reply_end(const std::string& heard, int lines, bool at_once) const;
  // The lines of an answer without their frames, \n between them. An error is of a line that has to be read empty.
  Result<std::string> answer(const std::string& sent_body, const std::string& reply, const std::string& heard,
                             int lines) const;
  Judgement garbled(const std::string& what) const;
  const std::string& end_of_answer() const { return link_.prompt.empty() ? link_.terminator_in : link_.prompt; }

 private:
  Result<std::string> bodies_of(const std::string& frames, int lines) const;
  DialectLink link_;
};

std::unique_ptr<TableCodec> codec_of(const Dialect& dialect);

}  // namespace turncal
