#include "orchestrator/jobs/command_context.h"

#include <algorithm>

#include "orchestrator/watch/progress.h"

namespace turncal {

namespace {

std::string one_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

void CommandContext::fail(const Error& error) {
  err << tag << in_tone(err, Tone::bad, "turncal:") << ' ' << one_line(error.message) << std::endl;
  exit_code = turncal::exit_code(error.kind);
}

void CommandContext::warn(const std::string& text) { err << tag << "warning: " << one_line(text) << std::endl; }

}  // namespace turncal
