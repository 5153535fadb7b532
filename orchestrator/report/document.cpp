#include "orchestrator/report/document.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <map>

#include "imu_io/base/data_text.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"
#include "orchestrator/station/child_program.h"
#include "orchestrator/watch/page_server.h"

namespace turncal {

extern const std::string_view report_page_css;  // report_page.css
extern const std::string_view figure_css;       // figures/figure.css

namespace cell {

Cell text(std::string_view words) { return {Cell::Kind::text, std::string(words)}; }
Cell wide(std::string_view words) { return {Cell::Kind::wide, std::string(words)}; }
Cell name(std::string_view words) { return {Cell::Kind::name, std::string(words)}; }
Cell word(std::string_view of_file) { return {Cell::Kind::word, std::string(of_file)}; }
Cell number(std::string_view words, double value) { return {Cell::Kind::number, std::string(words), value}; }
Cell number(double value, int digits) { return number(significant(value, digits, Alphabet::typographic), value); }
Cell number(const std::optional<double>& value, int digits) { return value ? number(*value, digits) : number("-"); }
Cell below(double limit, int digits) {
  return {Cell::Kind::number, "< " + significant(limit, digits), limit, {}, true};
}
Cell fixed(double value, int decimals) { return number(with_decimals(value, decimals), value); }
Cell count(std::size_t value) { return number(std::to_string(value), double(value)); }
Cell with_sigma(double value, double sigma) {
  return number(value_with_sigma(value, sigma, Alphabet::typographic), value);
}
Cell linked(Cell cell, std::string link) {
  cell.link = std::move(link);
  return cell;
}
Cell bar(double share) { return {Cell::Kind::bar, "", share}; }
Cell half(double share) { return {Cell::Kind::half, "", share}; }

}  // namespace cell

namespace {

constexpr std::size_t label_width = 16;  // of facts, on the terminal

bool is_drawn(const Cell& cell) { return cell.kind == Cell::Kind::bar || cell.kind == Cell::Kind::half; }

// Returns the words for people.
std::string for_people(const Cell& cell) { return cell.kind == Cell::Kind::word ? in_words(cell.words) : cell.words; }

std::string padded(const std::string& text, std::size_t width, bool right) {
  const std::string blanks(width - std::min(width, columns_of(text)), ' ');
  return right ? blanks + text : text + blanks;
}

class TextLines {
 public:
  void operator()(const Heading& heading) {
    if (!lines.empty()) lines.emplace_back();
    lines.push_back(plain(heading.title));
  }
  void operator()(const Paragraph& paragraph) { lines.push_back(plain(paragraph.words)); }
  void operator()(const Facts& facts) {
    constexpr std::size_t most = 7;
    const std::size_t left = terminal_columns - label_width;
    for (const auto& [label, words] : facts.rows) {
      const bool beside = !facts.list;  // else the label begins the words
      std::vector<std::string> parts = wrap(plain(beside || label.empty() ? words : label + " " + words), left);
      if (parts.size() > most) {
        parts.resize(most);
        parts.back() = shorten(parts.back() + " ...", left);
      }
      for (std::size_t k = 0; k < parts.size(); ++k)
        lines.push_back(padded(beside && k == 0 ? plain(label) : "",
                               beside  ? label_width
                               : k > 0 ? 2
                                       : 0,
                               false) +
                        shorten(parts[k], left));
    }
  }
  void operator()(const Table& table) {
    constexpr std::size_t apart = 2, least = 20;
    std::vector<std::vector<std::string>> rows(1);
    for (const Cell& cell : table.head) rows[0].push_back(plain(cell.words));
    for (std::size_t k = 0; k < std::min(table.rows.size(), table.most); ++k) {
      rows.emplace_back();
      for (const Cell& cell : table.rows[k].cells) rows.back().push_back(plain(for_people(cell)));
    }
    std::vector<std::size_t> widths(table.head.size(), 0);
    std::size_t all = 0;
    // The last column is never cut, because nothing follows it.
    const std::size_t last = widths.size() - (widths.empty() ? 0 : 1);
    for (std::size_t c = 0; c < widths.size(); ++c) {
      for (const auto& row : rows) widths[c] = std::max(widths[c], columns_of(row[c]));
      const bool is_long = c == last && table.head[c].kind == Cell::Kind::wide;
      if (widths[c] > 0) all += (is_long ? std::min(widths[c], least) : widths[c]) + apart;
    }
    for (std::size_t c = 0; c < last; ++c) {
      if (table.head[c].kind != Cell::Kind::wide || all <= terminal_columns + apart) continue;
      const std::size_t cut = std::min(all - terminal_columns - apart, widths[c] - std::min(widths[c], least));
      widths[c] -= cut;
      all -= cut;
    }
    for (const auto& row : rows) {
      std::string line;
      for (std::size_t c = 0; c < row.size(); ++c)
        if (widths[c] > 0 && !is_drawn(table.head[c]))
          line +=
              padded(shorten(row[c], std::max(widths[c], least)), widths[c], table.head[c].kind == Cell::Kind::number) +
              std::string(apart, ' ');
      line.erase(line.find_last_not_of(' ') + 1);
      lines.push_back(line);
    }
    if (table.rows.size() > table.most)
      lines.push_back(fmt::format("and {} more in the report", table.rows.size() - table.most));
  }
  void operator()(const Drawing&) {}

  std::vector<std::string> lines;
};

std::string tag(const char* name, const std::string& style, const std::string& inner) {
  return fmt::format("<{}{}>{}</{}>", name, style.empty() ? "" : " class=\"" + style + "\"", inner, name);
}

// Keeps a number and its percent sign on one line.
std::string words_html(std::string_view words) {
  std::string html = html_escape(words);
  for (std::size_t at = html.find(" %"); at != std::string::npos; at = html.find(" %", at))
    html.replace(at, 1, "&nbsp;");
  return html;
}

std::string cell_html(const char* name, const Cell& cell) {
  static constexpr std::array styles = {"", "w", "name", "n", "", "half", ""};
  constexpr double width_px = 150.0;
  constexpr std::size_t longest_line = 34;  // longer texts are broken, but not into single words
  std::string inner = html_escape(for_people(cell));
  if (!cell.link.empty()) inner = fmt::format("<a href=\"{}\">{}</a>", html_escape(url_escape(cell.link)), inner);
  if (is_drawn(cell) && std::abs(cell.value) * width_px >= 1.0) {
    const bool half = cell.kind == Cell::Kind::half;
    const double from = half ? 0.5 + 0.5 * std::min(cell.value, 0.0) : 0.0;
    const double length = std::abs(cell.value) * (half ? 0.5 : 1.0);
    inner = fmt::format("<span class=\"bar\" style=\"margin-left:{:.0f}px;width:{:.0f}px\"></span>", from * width_px,
                        length * width_px);
  }
  const std::string style = styles[std::size_t(cell.kind)];
  const bool is_long = cell.kind <= Cell::Kind::name && columns_of(cell.words) > longest_line;
  return tag(name, is_long ? style + " long" : style, inner);
}

std::string row_html(const char* name, const std::vector<Cell>& cells, const std::string& style) {
  std::string inner;
  for (const Cell& cell : cells) inner += cell_html(name, cell);
  return tag("tr", style, inner) + "\n";
}

struct Html {
  std::string operator()(const Heading& heading) const {
    return fmt::format("<h{}{}>{}</h{}>\n", heading.level, heading.id.empty() ? "" : " id=\"" + heading.id + "\"",
                       html_escape(heading.title), heading.level);
  }
  std::string operator()(const Paragraph& paragraph) const {
    const bool note = paragraph.style == "note", verdict = paragraph.style.starts_with("verdict");
    std::string words = words_html((note ? "Note: " : "") + paragraph.words);
    if (verdict) words.front() = char(std::toupper(static_cast<unsigned char>(words.front())));
    const std::size_t colon = words.find(':') + 1;  // 0: no colon
    if ((verdict || paragraph.style == "lead") && colon > 0)
      words = tag("b", "", words.substr(0, colon)) + words.substr(colon);
    return (verdict ? tag("div", paragraph.style, tag("p", "", words))
                    : tag("p", note ? "soft" : paragraph.style, words)) +
           "\n";
  }
  std::string operator()(const Facts& facts) const {
    std::string inner;
    for (const auto& [label, words] : facts.rows)
      inner +=
          facts.list
              ? tag("li", "", (label.empty() ? "" : tag("b", "", html_escape(label)) + " ") + html_escape(words)) + "\n"
              : row_html("td", {cell::text(label), cell::text(words)}, "");
    return facts.list ? tag("ul", "", "\n" + inner) + "\n" : tag("table", "facts", "\n" + inner) + "\n";
  }
  std::string operator()(const Table& table) const {
    static constexpr std::array emphases = {"", "hit", "dim"};
    std::string rows;
    for (const Table::Row& row : table.rows) rows += row_html("td", row.cells, emphases[std::size_t(row.emphasis)]);
    const std::string inner =
        fmt::format("\n<thead>{}</thead>\n<tbody>\n{}</tbody>\n", row_html("th", table.head, ""), rows);
    return tag("div", "wide", tag("table", table.style, inner)) + "\n";
  }
  std::string operator()(const Drawing& drawing) const {
    const auto svg = drawn.find(drawing.id);
    if (svg == drawn.end()) return tag("p", "missing", "This plot is missing: " + html_escape(problem) + ".") + "\n";
    std::string legend;
    for (const Drawing::Key& key : drawing.legend)
      legend += fmt::format("<span><i aria-hidden=\"true\" style=\"color:{}\">{}</i> {}</span>", key.colour, key.glyph,
                            html_escape(key.label));
    return fmt::format("<figure>\n{}{}\n{}</figure>\n", legend.empty() ? "" : tag("p", "legend", legend) + "\n",
                       tag("div", drawing.parts.empty() && drawing.width > 640 ? "wide" : "panels", svg->second),
                       drawing.caption.empty() ? "" : tag("figcaption", "", html_escape(drawing.caption)) + "\n");
  }

  std::map<std::string, std::string> drawn = {};  // SVG by id
  std::string problem = {};
};

// A section of the JSON text, built block by block.
class JsonSection {
 public:
  void operator()(const Paragraph& paragraph) { text_.push_back(plain(paragraph.words)); }
  void operator()(const Facts& facts) {
    for (const auto& [label, words] : facts.rows)
      label.empty() ? text_.push_back(plain(words)) : facts_.text(plain(label), plain(words)),
          any_fact_ |= !label.empty();
  }
  void operator()(const Table& table) {
    std::string rows;
    for (const Table::Row& row : table.rows) {
      JsonObject object;
      for (std::size_t c = 0; c < row.cells.size(); ++c) {
        const Cell& cell = row.cells[c];
        const std::string key = plain(table.head[c].words);
        if (is_drawn(cell)) continue;
        if (cell.is_limit) object.raw(key, "null");
        if (cell.kind == Cell::Kind::number && (std::isfinite(cell.value) || cell.words == "-"))
          object.number(cell.is_limit ? key + ", at most" : key, cell.value);
        else
          object.text(key, plain(cell.words));
      }
      rows += (rows.empty() ? "\n" : ",\n") + object.end();
    }
    tables_ += (tables_.empty() ? "[" : ",[") + rows + "]";
  }
  void operator()(const Heading&) {}
  void operator()(const Drawing&) {}
  bool empty() const { return text_.empty() && !any_fact_ && tables_.empty(); }
  std::string end(JsonObject head, const std::string& sections) {
    if (!text_.empty()) head.texts("text", text_);
    if (any_fact_) head.raw("facts", facts_.end());
    if (!tables_.empty()) head.raw("tables", "[" + tables_ + "]");
    if (!sections.empty()) head.raw("sections", "[" + sections + "]");
    return head.end();
  }

 private:
  std::vector<std::string> text_;
  JsonObject facts_;
  bool any_fact_ = false;
  std::string tables_;
};

// Returns the non-ASCII characters of a UTF-8 text, each once, with its code point.
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

// Returns the characters that no installed font has: they are blank in the PDF. Without fontconfig this is unknown.
std::string without_font(const std::string& html) {
  constexpr std::size_t most_asked = 200;
  std::vector<std::string> missing;
  std::size_t asked = 0;
  for (const auto& [character, code] : unusual_characters(html)) {
    if (++asked > most_asked) break;
    const Result<ChildEnd> fonts = pipe_through("fontconfig", {"fc-list", ":charset=" + code}, "");
    if (!fonts) return "";
    if (fonts->output.empty()) missing.push_back(character + " (U+" + code + ")");
  }
  if (missing.empty()) return "";
  return "no installed font has " + shorten(join(missing), 100) +
         ": blank in the PDF (the packages fonts-noto-cjk and fonts-noto-core have most)";
}

}  // namespace

void Table::drop(std::size_t first, std::size_t count) {
  const auto from = [&](std::vector<Cell>& cells) {
    const auto at = cells.begin() + std::ptrdiff_t(first);
    cells.erase(at, at + std::ptrdiff_t(count));
  };
  from(head);
  for (Row& row : rows) from(row.cells);
}

std::string plain(std::string_view text) {
  static constexpr std::array<std::string_view, 10> superscripts = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  static constexpr std::pair<std::string_view, std::string_view> words[] = {
      {"±", "+-"},     {"µ", "u"},        {"²", "^2"},         {"³", "^3"},    {"°C", "C"},  {"°", "deg"},
      {"″", "arcsec"}, {"√h", "sqrt(h)"}, {"√Hz", "sqrt(Hz)"}, {"σ", "sigma"}, {"χ", "chi"}, {"τ", "tau"},
      {"Δ", "delta"},  {"−", "-"},        {"“", "\""},         {"”", "\""}};
  constexpr std::string_view power = "×10", minus = "⁻";
  std::string result;
  while (!text.empty()) {
    const auto word = std::ranges::find_if(words, [text](const auto& w) { return text.starts_with(w.first); });
    if (text.starts_with(power)) {
      text.remove_prefix(power.size());
      const bool negative = text.starts_with(minus);
      if (negative) text.remove_prefix(minus.size());
      int exponent = 0;
      const auto next = [&] {
        return std::ranges::find_if(superscripts, [text](auto s) { return text.starts_with(s); });
      };
      for (auto digit = next(); digit != superscripts.end(); digit = next()) {
        exponent = 10 * exponent + int(digit - superscripts.begin());
        text.remove_prefix(digit->size());
      }
      result += fmt::format("e{:+03d}", negative ? -exponent : exponent);
    } else if (word != std::end(words)) {
      result += word->second;
      text.remove_prefix(word->first.size());
    } else {
      result += text.front();
      text.remove_prefix(1);
    }
  }
  return result;
}

std::string as_text(const Document& document, std::size_t most) {
  TextLines text;
  for (const Document::Block& block : document.blocks) {
    const auto* paragraph = std::get_if<Paragraph>(&block.content);
    if (paragraph != nullptr && paragraph->style == "note") ++most;
    if (block.scope == Scope::all || block.scope == Scope::terminal) std::visit(text, block.content);
  }
  if (text.lines.size() > most) {
    text.lines.resize(most - 1);
    text.lines.emplace_back("... more in the report");
  }
  return join(text.lines, "\n") + "\n";
}

std::string as_brief_text(const Document& document) {
  TextLines text;
  for (const Document::Block& block : document.blocks)
    if (block.scope == Scope::brief) std::visit(text, block.content);
  return text.lines.empty() ? "" : join(text.lines, "\n") + "\n";
}

std::string as_text(const Content& content) {
  Document document;
  document.add(content);
  return as_text(document);
}

std::string html(const Content& content) { return std::visit(Html{}, content); }

HtmlPage as_page(const Document& document, const GnuplotOptions& gnuplot) {
  Html html;
  std::vector<Drawing> drawings;
  for (const Document::Block& block : document.blocks)
    if (const auto* drawing = std::get_if<Drawing>(&block.content)) drawings.push_back(*drawing);
  if (!drawings.empty()) {
    const Result<std::vector<std::string>> rendered = render(drawings, gnuplot);
    if (!rendered) html.problem = rendered.error().message;
    for (std::size_t k = 0; rendered && k < drawings.size(); ++k) html.drawn[drawings[k].id] = (*rendered)[k];
  }
  std::string page = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n{}<title>{}</title>\n<style>{}{}</style>\n</head>\n<body>\n<main>\n"
      "<h1>{}</h1>\n",
      page_head, html_escape(document.title), report_page_css, figure_css, html_escape(document.heading));
  for (const Document::Block& block : document.blocks)
    if (block.scope != Scope::terminal) page += std::visit(html, block.content);
  return {page + "</main>\n</body>\n</html>\n", html.problem};
}

std::string as_json(const Document& document) {
  JsonObject whole;
  whole.text("title", plain(document.heading));
  JsonSection first, other;
  JsonObject head;
  std::string sections;
  bool in_section = false;
  const auto close = [&] {
    if (in_section && !other.empty()) sections += (sections.empty() ? "\n" : ",\n") + other.end(head, "");
    head = {};
    other = {};
  };
  for (const Document::Block& block : document.blocks) {
    if (block.scope == Scope::terminal) continue;
    if (const auto* heading = std::get_if<Heading>(&block.content)) {
      close();
      in_section = true;
      if (!heading->id.empty()) head.text("id", heading->id);
      head.text("title", plain(heading->title));
    } else {
      std::visit(in_section ? other : first, block.content);
    }
  }
  close();
  return first.end(std::move(whole), sections) + "\n";
}

std::string key_values_as(std::string_view format, std::string_view lines) {
  DataTable table({"key", "value"});
  while (!lines.empty()) {
    const std::string_view line = next_line(lines);
    const std::size_t equals = line.find('=');
    if (line.starts_with('#') || equals == std::string_view::npos) continue;
    const std::string_view key = trimmed(line.substr(0, equals));
    table.row({key, DataCell::of_item(key, trimmed(line.substr(equals + 1)))});
  }
  return format == "json" ? table.json_object() : table.csv();
}

Result<std::string> write_pdf(const std::string& html, const std::string& path) {
  const Result<ChildEnd> pdf = pipe_through("weasyprint", {"weasyprint", "--encoding", "utf-8", "-", "-"}, html, 120.0);
  if (!pdf) return device_error(path + ": " + pdf.error().message);
  if (!pdf->output.starts_with("%PDF-")) return device_error(path + ": weasyprint made no PDF");
  TRY(write_file_atomically(path, pdf->output));
  return without_font(html);
}

}  // namespace turncal
