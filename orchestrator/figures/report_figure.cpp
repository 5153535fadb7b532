#include "orchestrator/figures/report_figure.h"

#include <algorithm>
#include <cmath>

namespace turncal {

const char* html_colour(Colour colour) {
  switch (colour) {
    case Colour::before: return "#D55E00";  // vermillion
    case Colour::after: return "#0072B2";   // blue
    case Colour::x: return "#0072B2";
    case Colour::y: return "#D55E00";
    case Colour::z: return "#009E73";  // bluish green
    case Colour::neutral: return "#8A8A8A";
  }
  return "#000000";
}

bool Panel::empty() const {
  return std::all_of(series.begin(), series.end(), [](const Series& s) {
    return std::none_of(s.points.begin(), s.points.end(),
                        [](const auto& p) { return std::isfinite(p.first) && std::isfinite(p.second); });
  });
}

std::vector<std::pair<double, double>> outline(const std::vector<std::pair<double, double>>& points,
                                               std::size_t limit) {
  if (points.size() <= limit) return points;
  // Two points a bucket and room for a break after it.
  const std::size_t buckets = std::max<std::size_t>(limit / 3, 1);
  std::vector<std::pair<double, double>> result;
  for (std::size_t k = 0; k < buckets; ++k) {
    const std::size_t begin = k * points.size() / buckets;
    const std::size_t end = (k + 1) * points.size() / buckets;
    std::size_t low = end;
    std::size_t high = end;
    std::size_t gap = end;
    for (std::size_t i = begin; i < end; ++i) {
      if (!std::isfinite(points[i].first) || !std::isfinite(points[i].second)) {
        gap = i;
        continue;
      }
      if (low == end || points[i].second < points[low].second) low = i;
      if (high == end || points[i].second >= points[high].second) high = i;
    }
    std::vector<std::size_t> kept;
    for (const std::size_t i : {low, high, gap})
      if (i != end && std::find(kept.begin(), kept.end(), i) == kept.end()) kept.push_back(i);
    std::sort(kept.begin(), kept.end());
    for (const std::size_t i : kept) result.push_back(points[i]);
  }
  return result;
}

}  // namespace turncal
