#include "imu_io/base/closest_word.h"

#include <algorithm>
#include <array>

#include "imu_io/base/text_pieces.h"

namespace turncal {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  // rows[0] is of a's first i letters, rows[1] and rows[2] of one and two letters fewer.
  std::array<std::vector<std::size_t>, 3> rows;
  for (auto& row : rows) row.resize(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) rows[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::rotate(rows.begin(), rows.end() - 1, rows.end());
    rows[0][0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const bool same = a[i - 1] == b[j - 1];
      rows[0][j] = std::min({rows[1][j] + 1, rows[0][j - 1] + 1, rows[1][j - 1] + (same ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        rows[0][j] = std::min(rows[0][j], rows[2][j - 2] + 1);
    }
  }
  return rows[0][b.size()];
}

std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known) {
  constexpr std::size_t longest = 80;  // nobody means a word with that; the work is bounded
  if (typed.empty() || typed.size() > longest) return "";
  const std::size_t most = std::min<std::size_t>(3, (typed.size() + 1) / 3);
  std::pair<std::size_t, bool> closest(most + 1, false);
  std::string meant;
  for (const std::string& word : known) {
    if (word.empty() || word.size() > longest) continue;
    const std::pair<std::size_t, bool> distance(edit_distance(typed, word), typed.front() != word.front());
    if (distance >= closest) continue;
    closest = distance;
    meant = word;
  }
  return meant.empty() ? "" : "; did you mean " + quoted(meant) + "?";
}

}  // namespace turncal
