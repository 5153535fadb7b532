// Sentences that would do more than they are called: a `prepare`, `identify`, `status`, `stop`, `abort` or `clear_fault` that sends what enables
// a drive, homes or moves it, and axes that one move would move together. A pure function of the dialect; of register maps: write_clash.h.
//
// What starts something is the last sentence of `enable` and `home` that is no question (with a `?`), and of `move` that one and every
// sentence with {position} or {distance}. A sentence may hold several commands, with semicolons between them; each is compared, with the
// names of all axes filled in.
#pragma once

#include <optional>
#include <string>

#include "turntable_drivers/ascii/dialect.h"

namespace turncal {

struct SentenceClash {
  std::string key;  // of the dialect
  std::string expected;
};
std::optional<SentenceClash> sentence_clash(const Dialect& dialect);

}  // namespace turncal
