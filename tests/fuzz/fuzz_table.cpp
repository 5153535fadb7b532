// What describes a table, and what a table answers (byte 0 chooses): register map, dialect, the answer to a sentence of a shipped dialect,
// requests to the drive twin. Messages are one line; what is taken out of an answer is a part of it; a request that is taken holds
// as many values as it says.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <vector>

#include "imu_io/base/text.h"
#include "input.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/modbus/modbus_frame.h"
#include "turntable_drivers/modbus/register_map.h"

namespace turncal {
namespace {

const std::vector<Dialect>& dialects() {
  static const std::vector<Dialect> all = [] {
    std::vector<Dialect> result;
    for (const char* name : {"acutronic_acl", "newport_esp30x", "pi_gcs2", "three_axis_dollar"})
      result.push_back(
          read_dialect(TURNCAL_SOURCE_DIR "/turntable_drivers/ascii/dialects/" + std::string(name) + ".dialect")
              .value());
    return result;
  }();
  return all;
}

void answer(fuzz::Input& input) {
  const Dialect& dialect = dialects()[input.byte() % dialects().size()];
  const DialectSteps& steps = dialect.steps[input.byte() % dialect.steps.size()];
  const std::string body(input.text());
  const auto match = [&body](const SentenceTemplate& pattern) {
    const auto values = pattern.match(body);
    if (!values) return;
    for (const auto& [name, value] : *values) {
      fuzz::require(!value.empty() && body.find(value) != std::string::npos);
      if (name != "*") fuzz::require(value.find_first_of(" ,") == std::string::npos);
    }
    const auto again =
        pattern.fill([&values](const std::string& name) { return name == "*" ? std::string() : values->at(name); });
    if (!pattern.has("*") && values->size() == pattern.names().size()) fuzz::require(again == body);
  };
  for (const Exchange& exchange : steps.exchanges) {
    match(exchange.send);
    if (exchange.expect) match(*exchange.expect);
  }
  const AxisReading flags = flags_of(dialect.status, body);
  if (!flags.known) fuzz::require(flags[DriveBit::in_position] != std::optional(true));
  if (const auto number = device_number(body)) fuzz::require(std::isfinite(*number));
  fuzz::require(check_digits(body, SentenceCheck::sum8).size() == 2);
  fuzz::require(visible(body).find('\n') == std::string::npos);
  (void)unescaped(body);
}

void requests(fuzz::Input& input) {
  const bool tcp = (input.byte() & 1U) != 0;
  std::vector<std::uint8_t> bytes;
  bytes.reserve(input.rest.size());
  std::ranges::transform(input.rest, std::back_inserter(bytes),
                         [](std::byte b) { return std::to_integer<std::uint8_t>(b); });
  for (std::size_t before = bytes.size() + 1; before > bytes.size();) {
    before = bytes.size();
    const auto request = next_request(bytes, tcp);
    if (!request) break;
    fuzz::require(bytes.size() < before);
    if (!request->well_formed) {
      (void)exception_reply(*request, 3, tcp);
    } else if (request->function == 3 || request->function == 4) {
      fuzz::require(request->count >= 1 && request->count <= 125);
      (void)read_reply(*request, std::vector<std::uint16_t>(std::size_t(request->count)), tcp);
    } else {
      if (request->function == 6 || request->function == 16)
        fuzz::require(request->values.size() == std::size_t(request->count));
      (void)write_reply(*request, tcp);
    }
  }
}

}  // namespace
}  // namespace turncal

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  fuzz::Input input(data, size);
  const std::uint8_t which = input.byte();
  switch (which % 4) {
    case 0: (void)fuzz::taken(parse_register_map(std::string(input.text()), "fuzz")); break;
    case 1: (void)fuzz::taken(parse_dialect(std::string(input.text()), "fuzz")); break;
    case 2: answer(input); break;
    default: requests(input); break;
  }
  return 0;
}
