#include "orchestrator/figures/gnuplot.h"

#include <charconv>

#include "orchestrator/figures/piped_program.h"
#include "orchestrator/figures/report_format.h"

namespace turncal {
namespace {

Error failure(const std::string& what) { return {ErrorKind::internal, "no plots: " + what}; }

std::vector<std::string> split_drawings(const std::string& text) {
  constexpr std::string_view begin_mark = "<svg";
  constexpr std::string_view end_mark = "</svg>";
  std::vector<std::string> drawings;
  for (std::size_t at = text.find(begin_mark); at != std::string::npos; at = text.find(begin_mark, at)) {
    const std::size_t end = text.find(end_mark, at);
    if (end == std::string::npos) break;  // cut off
    drawings.push_back(text.substr(at, end + end_mark.size() - at));
    at = end;
  }
  return drawings;
}

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
}

// Takes out every stretch from `begin` to `end`, both included.
void remove_all(std::string& text, std::string_view begin, std::string_view end) {
  for (std::size_t at = text.find(begin); at != std::string::npos; at = text.find(begin, at)) {
    const std::size_t stop = text.find(end, at + begin.size());
    if (stop == std::string::npos) return;
    text.erase(at, stop + end.size() - at);
  }
}

// gnuplot says a colour once and refers to it as currentColor, which not every program that makes a PDF understands. Its symbols with an
// even number from 4 on are filled.
void name_colours(std::string& text) {
  const std::string_view mark = " color=", symbol = "gpPt";
  for (std::size_t at = text.find(mark); at != std::string::npos; at = text.find(mark, at)) {
    const std::size_t value = at + mark.size() + 1, end = text.find(text[value - 1], value);
    if (end == std::string::npos) return;
    const std::string colour = "\"" + text.substr(value, end - value) + "\"";
    const std::size_t tag = text.rfind('<', at), number = text.find(symbol, tag);
    int n = 0;
    if (number < at) std::from_chars(text.data() + number + symbol.size(), text.data() + at, n);
    const bool filled = n >= 4 && n % 2 == 0;
    const std::string named = " stroke=" + colour + (filled ? " fill=" + colour : "");
    text.replace(at, end + 1 - at, named);
    at += named.size();
  }
  for (const char* reference :
       {" stroke=\"currentColor\"", " stroke='currentColor'", " fill=\"currentColor\"", " fill='currentColor'"})
    replace_all(text, reference, "");
}

}  // namespace

Result<std::vector<std::string>> run_gnuplot(std::string_view script, std::size_t drawings,
                                             const GnuplotOptions& options) {
  // Its standard input it reads a byte at a time, what a command gives it as a file: a third of the time of a report.
  const Result<PipedOutput> drawn =
      pipe_through({options.program, {"-d", "-e", "load '<cat'"}, "gnuplot-nox", options.deadline_s}, script);
  if (!drawn) return failure(drawn.error().message);
  std::vector<std::string> result = split_drawings(drawn->output);
  if (result.size() != drawings)
    return failure(options.program + " drew " + std::to_string(result.size()) + " of " + std::to_string(drawings) +
                   " plots" + (drawn->message.empty() ? "" : ": " + drawn->message));
  return result;
}

std::string embeddable_svg(std::string_view svg, std::string_view id, std::string_view label, std::string_view width) {
  std::string text(svg);
  // Panels of a multiplot repeat ids, and titles would show up as tooltips with the names of data blocks.
  remove_all(text, " id=\"gnuplot_plot_", "\"");
  remove_all(text, " id=\"gnuplot_canvas", "\"");
  remove_all(text, "<title>", "</title>");
  remove_all(text, "<desc>", "</desc>");
  remove_all(text, " font-family=\"", "\"");
  name_colours(text);
  const std::string prefix(id);
  replace_all(text, "id='", "id='" + prefix);
  replace_all(text, "href='#", "href='#" + prefix);
  replace_all(text, "url(#", "url(#" + prefix);
  replace_all(text, "<tspan >", "<tspan>");
  const std::string open = "<svg";
  if (text.starts_with(open)) {
    text.insert(open.size(),
                " role=\"img\" aria-label=\"" + html_escape(label) + "\" style=\"width:" + std::string(width) + "\"");
  }
  return text;
}

}  // namespace turncal
