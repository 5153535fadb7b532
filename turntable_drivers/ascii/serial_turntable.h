// SerialTurntable: a table that speaks an ASCII dialect over a serial line or TCP, wholly described by a Dialect. The driver is
// DescribedTurntable; this is the language of sentences (turntable_drivers/table/table_codec.h):
//
// - Frame: prefix + body + (check_mark + check digits) + terminator. An answer with a wrong prefix, a wrong or missing check, or more
//   characters after it than there should be is an error. An echo has to be what was sent.
// - An answer has to match its template, a number has to be a number, a status has to be known; else it is an error, or "not arrived".
#pragma once

#include <atomic>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/described_turntable.h"

namespace turncal {

class SerialTurntable : public DescribedTurntable {
 public:
  // The clock and the count must outlive the table.
  SerialTurntable(const Dialect& dialect, const Clock& clock, const std::atomic<int>* stop_requests = nullptr);
};

}  // namespace turncal
