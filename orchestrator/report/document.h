// A result as data: headings, paragraphs, facts, tables with typed cells, drawings. Each result is made into one document; terminal,
// page and JSON are renderings of it. Texts are typographic (28.35 ± 0.91 µg/g²); the terminal gets them as ASCII (plain()).
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "calib/types/status.h"
#include "orchestrator/figures/drawing.h"
#include "orchestrator/station/number_text.h"

namespace turncal {

struct Cell {
  // wide: may be broken or cut; name: of a thing; bar: 0 to 1 of its width; half: -1 to 1 from its middle; word: of a file, as
  // conditional_pass, which JSON keeps.
  enum class Kind { text, wide, name, number, bar, half, word };
  Kind kind = Kind::text;
  std::string words;
  double value = std::numeric_limits<double>::quiet_NaN();  // NaN: the words are all there is
  std::string link = {};                                    // where the words lead on a page; empty: nowhere
};

namespace cell {
Cell text(std::string_view words);
Cell wide(std::string_view words);
Cell name(std::string_view words);
Cell word(std::string_view of_file);
Cell number(std::string_view words, double value = std::numeric_limits<double>::quiet_NaN());  // words: as it is shown
Cell number(double value, int digits = 3);                                                     // significant digits
Cell number(const std::optional<double>& value, int digits = 3);                               // "-": there is none
Cell fixed(double value, int decimals);
Cell count(std::size_t value);
Cell with_sigma(double value, double sigma);  // to the second significant digit of sigma
Cell linked(Cell cell, std::string link);
Cell bar(double share);
Cell half(double share);
}  // namespace cell

struct Table {
  enum class Emphasis { none, hit, dim };
  struct Row {
    std::vector<Cell> cells;
    Emphasis emphasis;
  };
  std::vector<Cell> head;  // the kinds of the columns, too
  std::vector<Row> rows = {};
  std::string style = {};                                      // of the page
  std::size_t most = std::numeric_limits<std::size_t>::max();  // rows on the terminal
  void row(std::vector<Cell> cells, Emphasis emphasis = Emphasis::none) {
    rows.push_back({std::move(cells), emphasis});
  }
  void drop(std::size_t first, std::size_t count = 1);  // columns
};

struct Heading {
  int level = 2;
  std::string id, title;
};

struct Paragraph {
  std::string words;
  // Of the page: soft, note, loud; lead and "verdict <which>" are bold up to their colon.
  std::string style = {};
};

// On the terminal two columns, the second one wrapped; on a page a table, or a list.
struct Facts {
  std::vector<std::pair<std::string, std::string>> rows = {};
  bool list = false;
  void add(std::string label, std::string_view words) { rows.emplace_back(std::move(label), words); }
};

// page: page and JSON; brief: those, and a terminal without --verbose.
enum class Scope { all, page, terminal, brief };

using Content = std::variant<Heading, Paragraph, Facts, Table, Drawing>;

struct Document {
  struct Block {
    Content content;
    Scope scope;
  };
  std::string title = {};    // of the window; empty: no page is made of it
  std::string heading = {};  // at the top of the page
  std::vector<Block> blocks = {};
  Scope scope = Scope::all;  // of blocks that are added without one

  void add(Content content) { add(std::move(content), scope); }
  void add(Content content, Scope where) { blocks.push_back({std::move(content), where}); }
  void section(std::string id, std::string name) { add(Heading{2, std::move(id), std::move(name)}); }
  void subsection(std::string name) { add(Heading{3, "", std::move(name)}); }
  void text(std::string words) { add(Paragraph{std::move(words)}); }
  void soft(std::string words, Scope where = Scope::page) { add(Paragraph{std::move(words), "soft"}, where); }
  // Nothing of a figure without panels.
  void figure(const Figure& figure) {
    if (!figure.panels.empty()) add(draw(figure), Scope::page);
  }
};

inline constexpr std::size_t terminal_columns = 100;
// "20.25 +- 0.75 ug/g^2" of "20.25 ± 0.75 µg/g²".
std::string plain(std::string_view typographic);
// For the terminal, of at most so many lines, notes not counted.
std::string as_text(const Document& document, std::size_t most = 100'000);
std::string as_text(const Content& content);
// Blocks that are brief, each fact on one line.
std::string as_brief_text(const Document& document);

struct HtmlPage {
  std::string html;
  std::string plot_problem;  // one line when there are no plots, else empty
};
// Self-contained: style and drawings (gnuplot) inline, no scripts. Without gnuplot it says so in the place of each.
HtmlPage as_page(const Document& document, const GnuplotOptions& gnuplot = {});
std::string html(const Content& content);  // of all but drawings

// A page as PDF, by weasyprint within two minutes (child_program.h). What there is to warn of, for people, in one line; empty: nothing.
// An error leaves no file.
Result<std::string> write_pdf(const std::string& html, const std::string& path);

// {"title", "text": [...], "facts": {...}, "tables": [[{...}]], "sections": [{"id", "title", ...}]}: keys of rows are the heads of columns.
std::string as_json(const Document& document);

// For people, or "json".
inline std::string as(const std::string& format, const Document& document) {
  return format.empty() ? as_text(document) : as_json(document);
}

// A file of keys and values (KeyValues) as one JSON object, or as CSV with a line a key.
std::string key_values_as(std::string_view format, std::string_view lines);

}  // namespace turncal
