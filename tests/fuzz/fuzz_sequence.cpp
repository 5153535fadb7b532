// Text into the sequence parser; what is accepted is planned too.
#include <string>

#include "input.h"
#include "sequences/plan.h"
#include "sequences/sequence.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  const auto sequence = parse_sequence(std::string(fuzz::Input(data, size).text()), "fuzz");
  if (!fuzz::taken(sequence)) {
    fuzz::require(sequence.error().message.starts_with("fuzz:"));
    return 0;
  }
  fuzz::require(!sequence->steps.empty());
  fuzz::require(make_plan(*sequence, PlanLimits{}).samples > 0);
  return 0;
}
