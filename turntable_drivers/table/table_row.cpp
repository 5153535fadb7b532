#include "turntable_drivers/table/table_row.h"

#include <algorithm>
#include <array>

namespace turncal {

std::string source_of(const TableDescription& table, const std::string& key) {
  for (const LineSource& line : table.lines) {
    if (line.key != key) continue;
    return "line " + std::to_string(line.line) + (line.mark.empty() ? "" : " [" + line.mark + "]");
  }
  return "";
}

std::string format_rows(const std::vector<TableRow>& rows) {
  constexpr std::array<std::string TableRow::*, 6> columns = {
      &TableRow::operation, &TableRow::axis, &TableRow::sent, &TableRow::says, &TableRow::answer, &TableRow::source};
  std::vector<TableRow> all{{"operation", "axis", "sent or read", "what it says", "answer expected", "from"}};
  all.insert(all.end(), rows.begin(), rows.end());
  std::array<std::size_t, columns.size()> width{};
  for (const TableRow& row : all)
    for (std::size_t i = 0; i < columns.size(); ++i) width[i] = std::max(width[i], (row.*columns[i]).size());
  std::string text;
  for (const TableRow& row : all) {
    std::string line;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const std::string& cell = row.*columns[i];
      line += cell + std::string(width[i] + 2 - cell.size(), ' ');
    }
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

}  // namespace turncal
