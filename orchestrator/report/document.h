// A result as data: headings, paragraphs, facts, tables with typed cells, drawings. Each result is one document; terminal,
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
  // wide: may be broken or cut; name: names a thing; bar: 0 to 1 of the cell's width; half: -1 to 1 from its middle; word: a word of a file, such
  // as conditional_pass, which JSON keeps as it is.
  enum class Kind { text, wide, name, number, bar, half, word };
  Kind kind = Kind::text;
  std::string words;
  double value = std::numeric_limits<double>::quiet_NaN();  // NaN: there are only words
  std::string link = {};                                    // target of the words on a page; empty: none
  bool is_limit = false;                                    // the value is not known, only that it is below this
};

namespace cell {
Cell text(std::string_view words);
Cell wide(std::string_view words);
Cell name(std::string_view words);
Cell word(std::string_view of_file);
Cell number(std::string_view words, double value = std::numeric_limits<double>::quiet_NaN());  // words: as shown
Cell number(double value, int digits = 3);                                                     // significant digits
Cell number(const std::optional<double>& value, int digits = 3);                               // "-" without a value
Cell below(double limit, int digits);
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
  std::vector<Cell> head;  // also gives the kinds of the columns
  std::vector<Row> rows = {};
  std::string style = {};                                      // on the page
  std::size_t most = std::numeric_limits<std::size_t>::max();  // most rows on the terminal
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
  // On the page: soft, note, loud; lead and "verdict <which>" are bold up to their colon.
  std::string style = {};
};

// Two columns on the terminal, the second one wrapped; a table, or a list, on a page.
struct Facts {
  std::vector<std::pair<std::string, std::string>> rows = {};
  bool list = false;
  void add(std::string label, std::string_view words) { rows.emplace_back(std::move(label), words); }
};

// Where a block appears. page: page and JSON; brief: page, JSON, and a terminal without --verbose.
enum class Scope { all, page, terminal, brief };

using Content = std::variant<Heading, Paragraph, Facts, Table, Drawing>;

struct Document {
  struct Block {
    Content content;
    Scope scope;
  };
  std::string title = {};    // title of the window; empty: no page is made
  std::string heading = {};  // at the top of the page
  std::vector<Block> blocks = {};
  Scope scope = Scope::all;  // scope of blocks added without one

  void add(Content content) { add(std::move(content), scope); }
  void add(Content content, Scope where) { blocks.push_back({std::move(content), where}); }
  void section(std::string id, std::string name) { add(Heading{2, std::move(id), std::move(name)}); }
  void subsection(std::string name) { add(Heading{3, "", std::move(name)}); }
  void text(std::string words) { add(Paragraph{std::move(words)}); }
  void soft(std::string words, Scope where = Scope::page) { add(Paragraph{std::move(words), "soft"}, where); }
  // Adds a figure, unless it has no panels.
  void figure(const Figure& figure) {
    if (!figure.panels.empty()) add(draw(figure), Scope::page);
  }
};

inline constexpr std::size_t terminal_columns = 100;
// Returns "20.25 +- 0.75 ug/g^2" for "20.25 ± 0.75 µg/g²".
std::string plain(std::string_view typographic);
// Renders for the terminal, in at most `most` lines, not counting notes.
std::string as_text(const Document& document, std::size_t most = 100'000);
std::string as_text(const Content& content);
// Renders the brief blocks, each fact on one line.
std::string as_brief_text(const Document& document);

struct HtmlPage {
  std::string html;
  std::string plot_problem;  // one line when there are no plots, else empty
};
// Renders a self-contained page: style and drawings (gnuplot) inline, no scripts. Without gnuplot a text replaces each drawing.
HtmlPage as_page(const Document& document, const GnuplotOptions& gnuplot = {});
std::string html(const Content& content);  // of everything except drawings

// Writes a page as PDF, by weasyprint within two minutes (child_program.h). Returns a warning for people, in one line; empty: none.
// An error leaves no file.
Result<std::string> write_pdf(const std::string& html, const std::string& path);

// Returns {"title", "text": [...], "facts": {...}, "tables": [[{...}]], "sections": [{"id", "title", ...}]}; the keys of rows are the column heads.
std::string as_json(const Document& document);

// Renders for people, or as "json".
inline std::string as(const std::string& format, const Document& document) {
  return format.empty() ? as_text(document) : as_json(document);
}

// Returns a file of keys and values (KeyValues) as one JSON object, or as CSV with one line for each key.
std::string key_values_as(std::string_view format, std::string_view lines);

}  // namespace turncal
