#include "orchestrator/report/pdf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/figures/piped_program.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {
namespace {

// Characters beyond ASCII of a UTF-8 text, each once, with its code point.
std::map<std::string, std::string> unusual_characters(std::string_view text) {
  std::map<std::string, std::string> found;
  while (!text.empty()) {
    std::uint32_t code = 0;
    const std::size_t length = printable_character(text) > 0 ? utf8_character(text, &code) : 1;
    if (length > 1) found.emplace(text.substr(0, length), fmt::format("{:04X}", code));
    text.remove_prefix(length);
  }
  return found;
}

// Those that no font installed here has: they are blank in the PDF. Without fontconfig nothing is known of it.
std::string without_font(const std::string& html) {
  constexpr std::size_t most_asked = 200, most_said = 5;
  std::vector<std::string> missing;
  std::size_t asked = 0;
  for (const auto& [character, code] : unusual_characters(html)) {
    if (++asked > most_asked) break;
    const Result<PipedOutput> fonts =
        pipe_through({.name = "fc-list", .arguments = {":charset=" + code}, .package = "fontconfig"}, "");
    if (!fonts) return "";
    if (fonts->output.empty()) missing.push_back(character + " (U+" + code + ")");
  }
  if (missing.empty()) return "";
  const std::size_t said = std::min(missing.size(), most_said);
  std::string words = join({missing.begin(), missing.begin() + static_cast<std::ptrdiff_t>(said)});
  if (missing.size() > said) words += " and " + std::to_string(missing.size() - said) + " more";
  return "no installed font has " + words +
         ": blank in the PDF (the packages fonts-noto-cjk and fonts-noto-core have most)";
}

}  // namespace

Result<std::string> write_pdf(const std::string& html, const std::string& path) {
  const Result<PipedOutput> pdf = pipe_through({.name = "weasyprint",
                                                .arguments = {"--encoding", "utf-8", "-", "-"},
                                                .package = "weasyprint",
                                                .deadline_s = 120.0},
                                               html);
  if (!pdf) return device_error(path + ": " + pdf.error().message);
  if (!pdf->output.starts_with("%PDF-")) return device_error(path + ": weasyprint made no PDF");
  TRY(write_file_atomically(path, pdf->output));
  return without_font(html);
}

}  // namespace turncal
