#include "orchestrator/figures/drawing.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "orchestrator/station/child_program.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

extern const std::string_view figure_css;  // figure.css

namespace {

Error failure(const std::string& what) { return {ErrorKind::internal, "no plots: " + what}; }

std::vector<std::string> split_drawings(const std::string& text) {
  constexpr std::string_view begin_mark = "<svg";
  constexpr std::string_view end_mark = "</svg>";
  std::vector<std::string> drawings;
  for (std::size_t at = text.find(begin_mark); at != std::string::npos; at = text.find(begin_mark, at)) {
    const std::size_t end = text.find(end_mark, at);
    if (end == std::string::npos) break;  // truncated
    drawings.push_back(text.substr(at, end + end_mark.size() - at));
    at = end;
  }
  return drawings;
}

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

// Removes every stretch from `begin` to `end`, both included.
void remove_all(std::string& text, std::string_view begin, std::string_view end) {
  for (std::size_t at = text.find(begin); at != std::string::npos; at = text.find(begin, at)) {
    const std::size_t stop = text.find(end, at + begin.size());
    if (stop == std::string::npos) return;
    text.erase(at, stop + end.size() - at);
  }
}

// Replaces currentColor, by which gnuplot refers to a colour defined once, because not every program that makes a PDF understands it.
// gnuplot's symbols with an even number from 4 on are filled.
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
    const std::string_view rest = std::string_view(text).substr(end, text.find('>', end) - end);
    const bool has_own = rest.find(" stroke=") < rest.size() && rest.find("currentColor") >= rest.size();
    const std::string named = has_own ? "" : " stroke=" + colour + (filled ? " fill=" + colour : "");
    text.replace(at, end + 1 - at, named);
    at += named.size();
  }
  for (const char* reference :
       {" stroke=\"currentColor\"", " stroke='currentColor'", " fill=\"currentColor\"", " fill='currentColor'"})
    replace_all(text, reference, "");
}

// Returns a drawing for an HTML page: the <svg> element with ids made unique by `id`, `label` (plain text) for readers that cannot see it,
// and `width` as in CSS ("50%").
std::string embeddable_svg(std::string_view svg, std::string_view id, std::string_view label, std::string_view width) {
  std::string text(svg);
  // Panels of a multiplot repeat ids, and titles would show up as tooltips with the names of data blocks.
  remove_all(text, " id=\"gnuplot_plot_", "\"");
  remove_all(text, " id=\"gnuplot_canvas", "\"");
  remove_all(text, "<title>", "</title>");
  remove_all(text, "<desc>", "</desc>");
  // Texts that gnuplot shows under the pointer by a script become titles, which need none.
  replace_all(text, "<g onmousemove=\"gnuplot_svg.showHypertext(evt,'", "<g><title>");
  replace_all(text, "')\" onmouseout=\"gnuplot_svg.hideHypertext()\">", "</title>");
  remove_all(text, " font-family=\"", "\"");
  name_colours(text);
  const std::string prefix(id);
  replace_all(text, "id='", "id='" + prefix);
  replace_all(text, "href='#", "href='#" + prefix);
  replace_all(text, "url(#", "url(#" + prefix);
  replace_all(text, "<tspan >", "<tspan>");
  if (const std::string_view open = "<svg"; text.starts_with(open))
    text.insert(open.size(),
                fmt::format(" role=\"img\" aria-label=\"{}\" style=\"width:{}\"", html_escape(label), width));
  return text;
}

constexpr const char* html_colours[] = {"#D55E00", "#0072B2", "#0072B2", "#D55E00", "#009E73", "#808080"};
const char* html_colour(Colour colour) { return html_colours[std::size_t(colour)]; }

struct StyleRow {
  const char *gnuplot, *glyph;
};
constexpr StyleRow style_rows[] = {
    {"lines lw 1.4", "—"},       {"lines dt 2 lw 1.4", "┄"},  {"points pt 6 ps 0.75 lw 1.5", "○"},
    {"points pt 7 ps 0.5", "●"}, {"points pt 9 ps 0.6", "▲"}, {"points pt 5 ps 0.45", "■"}};
const StyleRow& style_of(const Series& series) { return style_rows[std::size_t(series.style)]; }

bool is_known(const std::pair<double, double>& point) {
  return std::isfinite(point.first) && std::isfinite(point.second);
}
bool has_points(const Series& series) { return std::ranges::any_of(series.points, is_known); }

std::string gnuplot_terminal(int width, int height) {
  return fmt::format(
      "reset session\nset encoding utf8\nset terminal svg size {},{} dynamic noenhanced font 'Sans,13' background rgb "
      "'white'\nset border 3 lw 1 lc rgb '#333333'\nset grid lw 0.7 lc rgb '#D9D9D9'\n"
      "set tics nomirror scale 0.6 textcolor rgb '#333333'\nset clip two\nunset key\n",
      width, height);
}

std::string gnuplot_text(const std::string& text) {
  std::string result = "'";
  for (const char c : text) {
    if (c == '\'') result += '\'';
    if (c != '\n') result += c;
  }
  return result + "'";
}

void append_data(const std::string& name, const Series& series, std::string& script) {
  script += name + " << EOD\n";
  bool broken = true;  // true, so that a block does not begin with a break
  for (const auto& point : series.points) {
    const bool known = is_known(point);
    // Seven digits are more than a drawing can show.
    if (known)
      fmt::format_to(std::back_inserter(script), "{:.7g} {:.7g}\n", point.first, point.second);
    else if (!broken)
      script += '\n';
    broken = !known;
  }
  script += "EOD\n";
}

// Returns "SN0402: 0.0152 deg/h" or "temperature, °C: 23.4; residual, deg/h: 0.0152".
std::string tip_of(const Panel& panel, const Series& series, std::size_t k) {
  const std::string y = significant(series.points[k].second, 4, Alphabet::typographic);
  if (!series.names.empty()) return series.names[k] + ": " + y + " " + panel.y_label;
  const std::string x =
      panel.x_label.empty() ? "" : panel.x_label + ": " + significant(series.points[k].first, 4) + "; ";
  return x + panel.y_label + ": " + y;
}

// Adds a pointer target over each marker, unless there are too many to point at.
std::string append_tips(const Panel& panel, const std::string& id, std::string& script) {
  constexpr std::size_t most = 400;
  std::string targets;
  std::size_t count = 0;
  for (const Series& series : panel.series)
    for (std::size_t k = 0; series.style >= Series::Style::open_circle && k < series.points.size(); ++k) {
      if (!is_known(series.points[k])) continue;
      std::string tip = tip_of(panel, series, k);
      std::ranges::replace(tip, '"', '\'');
      targets += fmt::format("{:.7g} {:.7g} \"{}\"\n", series.points[k].first, series.points[k].second, tip);
      ++count;
    }
  if (count == 0 || count > most) return "";
  script += fmt::format("${}t << EOD\n{}EOD\n", id, targets);
  return fmt::format(", ${}t using 1:2:3 with labels hypertext point pt 7 ps 1.4 lc rgb '#FF000000' notitle", id);
}

struct Range {
  double low = 0.0, high = 0.0;
};
Range range_of(const Panel& panel, bool of_x) {
  Range r{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const Series& series : panel.series)
    for (const auto& [x, y] : series.points) {
      if (!std::isfinite(x) || (!of_x && !std::isfinite(y))) continue;  // an unknown point keeps its place
      r.low = std::min(r.low, of_x ? x : y);
      r.high = std::max(r.high, of_x ? x : y);
    }
  if (!(r.low <= r.high)) return {0.0, 1.0};
  return r;
}

// Returns the range with room at both ends; an empty range gets some width.
Range widened(Range r, double share) {
  double room = share * (r.high - r.low);
  if (!(room > 1e-12 * std::max(std::abs(r.low), std::abs(r.high)))) room = std::max(0.05 * std::abs(r.low), 1e-9);
  return {r.low - room, r.high + room};
}

// Returns 1, 2 or 5 times a power of ten (for angles a part of the circle), so that at most `most` fit into the range.
double tick_step(Range r, int most, bool angle) {
  const double least = (r.high - r.low) / most;
  if (angle)
    for (const double step : {5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0, 720.0})
      if (step >= least) return step;
  const double power = std::pow(10.0, std::floor(std::log10(least)));
  for (const double step : {1.0, 2.0, 5.0})
    if (step * power >= least) return step * power;
  return 10.0 * power;
}

void set_axis(const char* axis, Range r, int ticks, bool angle, std::string& script) {
  script += fmt::format("set {0}range [{1:.7g}:{2:.7g}]\nset {0}tics {3:.7g}\n", axis, r.low, r.high,
                        tick_step(r, ticks, angle));
}

// Sets whole decades around the data.
void set_decades(const char* axis, Range r, std::string& script) {
  script += fmt::format("set {0}range [{1:.7g}:{2:.7g}]\nset {0}tics autofreq\n", axis,
                        std::pow(10.0, std::floor(std::log10(r.low) + 1e-9)),
                        std::pow(10.0, std::ceil(std::log10(r.high) - 1e-9)));
}

// Adds the marks; a name that would touch the previous one is left out, its line stays.
void append_marks(const Panel& panel, int width, std::string& script) {
  constexpr double pixels_a_name = 16.0;
  script += "unset arrow\nunset label\n";
  if (panel.named_x) {
    std::vector<std::string> names;
    for (const auto& [at, name] : panel.marks) names.push_back(fmt::format("{} {:.7g}", gnuplot_text(name), at));
    script += "set xtics (" + join(names) + ")\n";
    return;
  }
  const Range x = range_of(panel, true);
  const double apart = pixels_a_name * (x.high - x.low) / width;
  double named = -1e300;
  for (const auto& [at, name] : panel.marks) {
    if (at < std::min(0.0, x.low) || at > x.high) continue;
    script += fmt::format(
        "set arrow from first {0:.7g}, graph 0 to first {0:.7g}, graph 1 nohead lw 0.6 lc rgb '#B8B8B8' back\n", at);
    if (at - named < apart) continue;
    script += fmt::format(
        "set label {} at first {:.7g}, graph 0.94 left offset 0.2,0 font 'Sans,10' textcolor rgb '#666666'\n",
        gnuplot_text(name), at);
    named = at;
  }
}

void append_panel(const Panel& panel, const std::string& id, int width, bool legend, std::string& script) {
  const auto title_width = std::size_t(width) / 7;  // characters, so that the frame cuts none
  std::string plot;
  for (std::size_t s = 0; s < panel.series.size(); ++s) {
    if (!has_points(panel.series[s])) continue;
    const Series& series = panel.series[s];
    const std::string name = fmt::format("${}s{}", id, s);
    append_data(name, series, script);
    plot += fmt::format("{}{} using 1:2 with {} lc rgb '{}'{}", plot.empty() ? "plot " : ", ", name,
                        style_of(series).gnuplot, html_colour(series.colour),
                        legend && !series.label.empty() ? " title " + gnuplot_text(series.label) : " notitle");
  }
  plot = plot.empty() ? "plot NaN notitle" : plot + append_tips(panel, id, script);
  script += legend ? "set key outside above right horizontal samplen 2\n" : "unset key\n";
  script += panel.title.empty() ? "unset title\n"
                                : "set title " + gnuplot_text(shorten(panel.title, title_width)) +
                                      (legend ? " offset graph -0.36, character -0.6\n" : " offset 0,-0.6\n");
  script += panel.x_label.empty() ? "unset xlabel\n" : "set xlabel " + gnuplot_text(panel.x_label) + " offset 0,0.4\n";
  script += "set ylabel " + gnuplot_text(panel.y_label) + " offset 0.5,0\n";
  if (panel.logarithmic) {
    script += "set logscale xy\nset format xy '%g'\n";
    set_decades("x", range_of(panel, true), script);
    set_decades("y", range_of(panel, false), script);
  } else {
    script += "unset logscale\nset format xy '%g'\n";
    const bool lines = !panel.series.empty() && panel.series.front().style == Series::Style::line;
    const Range x = range_of(panel, true);
    set_axis("x", lines ? Range{std::min(0.0, x.low), x.high} : widened(x, 0.06), std::max(5, width / 65), panel.angle,
             script);
    Range y = widened(range_of(panel, false), 0.08);
    if (panel.whole_frame)
      y = {-panel.y_limit, panel.y_limit};
    else if (panel.y_limit > 0.0)
      y = {std::max(y.low, -panel.y_limit), std::min(y.high, panel.y_limit)};
    set_axis("y", y, 6, false, script);
    script += "set xzeroaxis lw 1 lc rgb '#777777'\n";
  }
  append_marks(panel, width, script);
  script += plot + "\n";
}

std::vector<Drawing::Key> legend_of(const Figure& figure) {
  std::vector<Drawing::Key> legend;
  for (const Panel& panel : figure.panels)
    for (const Series& series : panel.series) {
      const auto same = [&](const Drawing::Key& key) { return key.label == series.label; };
      if (!series.label.empty() && has_points(series) && std::ranges::none_of(legend, same))
        legend.push_back({html_colour(series.colour), style_of(series).glyph, series.label});
    }
  return legend;
}

}  // namespace

Result<std::vector<std::string>> run_gnuplot(std::string_view script, std::size_t drawings,
                                             const GnuplotOptions& options) {
  // gnuplot reads its standard input byte by byte, but a command's output as a file, which makes a report much faster.
  const Result<ChildEnd> drawn =
      pipe_through("gnuplot-nox", {options.program, "-d", "-e", "load '<cat'"}, script, options.deadline_s);
  if (!drawn) return failure(drawn.error().message);
  std::vector<std::string> result = split_drawings(drawn->output);
  if (result.size() != drawings)
    return failure(fmt::format("{} drew {} of {} plots{}", options.program, result.size(), drawings, drawn->message()));
  return result;
}

bool Panel::empty() const { return std::ranges::none_of(series, has_points); }

std::vector<std::pair<double, double>> outline(const std::vector<std::pair<double, double>>& points,
                                               std::size_t limit) {
  if (points.size() <= limit) return points;
  // Two points a bucket and room for a break after it.
  const std::size_t buckets = std::max<std::size_t>(limit / 3, 1);
  std::vector<std::pair<double, double>> result;
  for (std::size_t k = 0; k < buckets; ++k) {
    const std::size_t begin = k * points.size() / buckets, end = (k + 1) * points.size() / buckets;
    std::size_t low = end, high = end, gap = end;
    for (std::size_t i = begin; i < end; ++i) {
      if (!is_known(points[i])) {
        gap = i;
        continue;
      }
      if (low == end || points[i].second < points[low].second) low = i;
      if (high == end || points[i].second >= points[high].second) high = i;
    }
    std::vector<std::size_t> kept;
    for (const std::size_t i : {low, high, gap})
      if (i != end && std::ranges::find(kept, i) == kept.end()) kept.push_back(i);
    std::ranges::sort(kept);
    for (const std::size_t i : kept) result.push_back(points[i]);
  }
  return result;
}

Figure small_panels(std::string id, std::string label, std::string caption) {
  Figure figure{std::move(id), std::move(label), std::move(caption)};
  figure.columns = 3;
  figure.panel_width = 320;
  figure.panel_height = 220;
  return figure;
}

Drawing draw(const Figure& figure, bool whole) {
  const int columns = std::min<int>(figure.columns, std::max<int>(1, int(figure.panels.size())));
  const int rows = (int(figure.panels.size()) + columns - 1) / std::max(columns, 1);
  const bool stacked = figure.stacked, apart = columns > 1 && !whole;
  const int width = figure.panel_width * (apart ? 1 : columns);
  Drawing drawing{figure.id, figure.label, {}, width, {}, legend_of(figure), figure.caption};
  std::string& script = drawing.script;
  if (!apart) {
    script = gnuplot_terminal(width, figure.panel_height * std::max(rows, 1));
    script += fmt::format("set multiplot layout {},{}\n", std::max(rows, 1), columns);
  }
  const std::string margins =
      stacked ? "set lmargin 10\nset rmargin 2\n" : "set lmargin\nset rmargin 2.5\nset bmargin 3.2\n";
  for (std::size_t k = 0; k < figure.panels.size(); ++k) {
    if (apart) {
      script += gnuplot_terminal(figure.panel_width, figure.panel_height);
      drawing.parts.push_back(figure.label + ": " + figure.panels[k].title + figure.panels[k].y_label);
    }
    if (apart || k == 0) script += margins;
    if (stacked) script += figure.panels[k].x_label.empty() ? "set bmargin 1.6\n" : "set bmargin 3.2\n";
    script += figure.panels[k].title.empty() ? "set tmargin 0.7\n" : "set tmargin 1.8\n";
    append_panel(figure.panels[k], figure.id + "p" + std::to_string(k), figure.panel_width, whole, script);
  }
  if (!apart) script += "unset multiplot\n";
  return drawing;
}

Result<std::vector<std::string>> render(const std::vector<Drawing>& drawings, const GnuplotOptions& options) {
  std::string script;
  std::size_t count = 0;
  for (const Drawing& drawing : drawings) {
    script += drawing.script;
    count += std::max<std::size_t>(1, drawing.parts.size());
  }
  const std::vector<std::string> svgs = TRY(run_gnuplot(script, count, options));
  std::vector<std::string> whole;
  std::size_t at = 0;
  for (const Drawing& drawing : drawings) {
    const std::string width = std::to_string(100 * std::min(drawing.width, 960) / 960) + "%";
    std::string& text = whole.emplace_back();
    if (drawing.parts.empty()) text = embeddable_svg(svgs[at++], drawing.id, drawing.label, width);
    for (std::size_t k = 0; k < drawing.parts.size(); ++k)
      text += embeddable_svg(svgs[at++], drawing.id + "p" + std::to_string(k), drawing.parts[k], width);
  }
  return whole;
}

Result<std::string> standalone_svg(const Figure& figure, const GnuplotOptions& options) {
  std::string svg = TRY(render({draw(figure, true)}, options)).front();
  const std::size_t style = svg.find("style=\"") + 7;
  svg.replace(style, svg.find('"', style) - style, "font-family:sans-serif;max-height:100vh");
  svg.insert(svg.find('>') + 1,
             "\n<title>" + html_escape(figure.label) + "</title>\n<style>" + std::string(figure_css) + "</style>\n");
  return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n" + svg + "\n";
}

}  // namespace turncal
