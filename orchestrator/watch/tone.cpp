#include "orchestrator/watch/tone.h"

#include <unistd.h>

#include <array>
#include <cstdlib>

namespace turncal {

namespace {

const int colours = std::ios_base::xalloc();

std::string_view variable(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

Tone tone_of(UnitVerdict verdict) {
  if (!is_accepted(verdict)) return Tone::bad;
  return verdict == UnitVerdict::conditional_pass ? Tone::attention : Tone::good;
}

void allow_colour(std::ostream& out, int descriptor) {
  out.iword(colours) = ::isatty(descriptor) == 1 && variable("NO_COLOR").empty() && variable("TERM") != "dumb" ? 1 : 0;
}

std::string in_tone(std::ostream& out, Tone tone, std::string_view text) {
  constexpr std::array<const char*, 3> codes = {"\x1b[32m", "\x1b[33m", "\x1b[31m"};
  if (out.iword(colours) == 0) return std::string(text);
  return codes[static_cast<std::size_t>(tone)] + std::string(text) + "\x1b[0m";
}

}  // namespace turncal
