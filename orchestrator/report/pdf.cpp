#include "orchestrator/report/pdf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <set>

#include "imu_io/base/atomic_file.h"
#include "imu_io/base/text_pieces.h"
#include "orchestrator/figures/piped_program.h"

namespace turncal {
namespace {

// Characters beyond ASCII of a UTF-8 text, each once.
std::set<std::string> unusual_characters(std::string_view text) {
  std::set<std::string> found;
  while (!text.empty()) {
    const std::size_t length = std::max<std::size_t>(printable_character(text), 1);
    if (length > 1) found.emplace(text.substr(0, length));
    text.remove_prefix(length);
  }
  return found;
}

std::string code_of(const std::string& character) {
  std::uint32_t code = static_cast<unsigned char>(character.front()) & (0x7FU >> character.size());
  for (std::size_t i = 1; i < character.size(); ++i)
    code = code << 6 | (static_cast<unsigned char>(character[i]) & 0x3FU);
  return fmt::format("{:04X}", code);
}

// Those that no font installed here has: they are blank in the PDF. Without fontconfig nothing is known of it.
std::string without_font(const std::string& html) {
  constexpr std::size_t most_asked = 200, most_said = 5;
  std::vector<std::string> missing;
  std::size_t asked = 0;
  for (const std::string& character : unusual_characters(html)) {
    if (++asked > most_asked) break;
    const Result<PipedOutput> fonts =
        pipe_through({.name = "fc-list", .arguments = {":charset=" + code_of(character)}, .package = "fontconfig"}, "");
    if (!fonts) return "";
    if (fonts->output.empty()) missing.push_back(character + " (U+" + code_of(character) + ")");
  }
  if (missing.empty()) return "";
  std::string words;
  for (std::size_t k = 0; k < std::min(missing.size(), most_said); ++k) words += (k > 0 ? ", " : "") + missing[k];
  if (missing.size() > most_said) words += " and " + std::to_string(missing.size() - most_said) + " more";
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
