#include "imu_io/recordings/map_proposal.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "calib/model/parameters.h"
#include "calib/statistics/distributions.h"
#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

// A column: how a map refers to it, and what the header says of it, in small letters.
struct Candidate {
  std::string reference, label;
};
struct Layout {
  TableFormat format;
  std::vector<Candidate> columns;
  bool named = true;
};

bool has_any(std::string_view text, std::initializer_list<std::string_view> words) {
  return std::ranges::any_of(words, [&](std::string_view word) { return text.find(word) != text.npos; });
}

std::string lower(std::string_view text) {
  std::string result(text);
  std::ranges::transform(result, result.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  return result;
}

std::vector<std::string_view> cells_of(std::string_view line, char delimiter) {
  return delimiter == ' ' ? split_words(line) : split(line, delimiter);
}

// Where the numbers of a text begin, what stands between them, and what stands above.
Result<Layout> look_at_text(std::string_view text, const std::string& file_name) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  std::vector<std::string_view> lines;
  while (lines.size() < 200 && !text.empty())
    if (const std::string_view line = next_line(text); !line.starts_with("//")) lines.push_back(line);
  Layout layout;
  std::size_t most = 5, first = 0;
  for (const char delimiter : {',', ';', '\t', ' '})
    for (std::size_t k = 0; k < lines.size(); ++k) {
      const auto numbers = static_cast<std::size_t>(std::ranges::count_if(
          cells_of(lines[k], delimiter), [](std::string_view cell) { return device_number(cell).has_value(); }));
      if (numbers <= most) continue;
      most = numbers;
      first = k;
      layout.format.delimiter = delimiter;
    }
  if (most == 5) return input_error(file_name + ": no row of six numbers or more: expected a table of an IMU");
  layout.format.header_lines = static_cast<int>(first);
  const auto row = cells_of(lines[first], layout.format.delimiter);
  const auto header = [&](std::size_t above) {
    std::string_view line = first >= above ? trimmed(lines[first - above]) : std::string_view();
    while (line.starts_with('#') || line.starts_with('%')) line = trimmed(line.substr(1));
    std::vector<std::string_view> cells = cells_of(line, layout.format.delimiter);
    cells.resize(cells.size() == row.size() ? row.size() : 0);
    return cells;
  };
  std::vector<std::string_view> names = header(1), units;
  if (!names.empty() && names[0].starts_with('('))
    std::swap(names, units), names = header(2);  // a line of units under the names
  layout.named = !names.empty();
  for (std::size_t k = 0; k < row.size(); ++k) {
    const std::string name(names.empty() ? "" : names[k]);
    const bool clear = !name.empty() && units.empty() && name.find_first_of(",#=") == name.npos &&
                       std::ranges::count(names, name) == 1;
    layout.columns.push_back(
        {clear ? name : std::to_string(k + 1), lower(name + (units.empty() ? "" : " " + std::string(units[k])))});
  }
  return layout;
}

using Triad = std::array<std::size_t, 3>;

// Every three columns whose labels differ in x, y and z, or 1, 2 and 3, alone.
std::vector<Triad> triads_of(const std::vector<Candidate>& columns) {
  std::vector<Triad> triads;
  for (const std::string_view letters : {"xyz", "123"}) {
    if (!triads.empty()) break;
    for (std::size_t i = 0; i < columns.size(); ++i)
      for (std::size_t at = columns[i].label.find(letters[0]); at != std::string::npos;
           at = columns[i].label.find(letters[0], at + 1)) {
        Triad triad{i, 0, 0};
        std::string label = columns[i].label;
        bool whole = true;
        for (std::size_t k = 1; k < 3; ++k) {
          label[at] = letters[k];
          const auto found = std::ranges::find(columns, label, &Candidate::label);
          whole = whole && found != columns.end();
          triad[k] = static_cast<std::size_t>(found - columns.begin());
        }
        if (whole) triads.push_back(triad);
      }
  }
  return triads;
}

struct Unit {
  std::string_view name;
  double si;
  bool is_rate;
  std::initializer_list<std::string_view> words;  // of a header
};
const Unit gyro_units[] = {{"deg/h", rad_per_deg / 3600.0, true, {"deg/h", "degph", "dph", "deg h"}},
                           {"arcsec", rad_per_deg / 3600.0, false, {"arcsec"}},
                           {"rad/s", 1.0, true, {"rad"}},
                           {"rad", 1.0, false, {"rad"}},
                           {"deg/s", rad_per_deg, true, {"deg", "dps", "\xC2\xB0"}},
                           {"deg", rad_per_deg, false, {"deg", "\xC2\xB0"}}};
const Unit accel_units[] = {{"m/s^2", 1.0, true, {"m/s^2", "m/s2", "mps2", "m s^-2", "m.s^-2", "ms-2", "m/s\xC2\xB2"}},
                            {"m/s", 1.0, false, {"m/s", "mps", "m s^-1"}},
                            {"mg", 9.80665e-3, true, {"_mg", "[mg", "(mg"}},
                            {"g", 9.80665, true, {"_g", "[g", "(g"}}};

template <std::size_t count>
const Unit* unit_in(const Unit (&units)[count], std::string_view label, bool is_rate) {
  for (const Unit& unit : units)
    if (unit.is_rate == is_rate && has_any(label, unit.words)) return &unit;
  return nullptr;
}

bool is_increment(std::string_view label) {
  return has_any(label, {"delta", "dtheta", "dang", "dvel", "dv_", "dth", "incr"}) || label.starts_with("dv");
}
bool is_gyro(std::string_view label) {
  if (has_any(label, {"mag", "bias", "cov", "std"})) return false;
  return has_any(label, {"gyr", "angular_vel", "angvel", "anglvel", "omega", "theta", "dang", "deltaang", "delta_ang",
                         "rate", "w_"}) ||
         label.starts_with("w") || label.starts_with("gx") || label.starts_with("g_");
}
// Acceleration without gravity is none.
bool is_accel(std::string_view label) {
  if (has_any(label, {"mag", "bias", "cov", "std", "free"})) return false;
  return has_any(label, {"acc", "specific", "force", "dv", "delta_v", "deltav", "a_rs"}) || label.starts_with("ax") ||
         label.starts_with("a_") || label.starts_with("fx") || label.starts_with("f_");
}

// ---- what the numbers say ----

struct Numbers {
  std::vector<double> t;  // in the file's unit; empty: none
  std::array<std::vector<double>, 3> gyro, accel;
};

double middle_norm(const std::array<std::vector<double>, 3>& triad) {
  std::vector<double> norms;
  for (std::size_t k = 0; k < triad[0].size(); ++k) norms.push_back(std::hypot(triad[0][k], triad[1][k], triad[2][k]));
  return median(norms);
}

const Unit* accel_unit_by_norm(double norm, double period_s) {
  for (const Unit& unit : accel_units)
    if (std::abs(norm * unit.si / (unit.is_rate ? 1.0 : period_s) / 9.80665 - 1.0) < 0.1) return &unit;
  return nullptr;
}

// By what factor gyro numbers become radians a second, where the unit turns enough to tell; negative: they turn the other way.
std::optional<double> gyro_scale(const Numbers& numbers, double period_s) {
  const auto width = static_cast<std::size_t>(std::clamp(0.2 / period_s, 1.0, 1000.0));
  const double usual = middle_norm(numbers.accel);
  const auto mean = [&](const std::array<std::vector<double>, 3>& triad, std::size_t from) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t k = from; k < from + width; ++k) sum[static_cast<Eigen::Index>(axis)] += triad[axis][k];
    return Eigen::Vector3d(sum / static_cast<double>(width));
  };
  double both = 0.0, turned = 0.0, moved = 0.0;
  int steps = 0;
  for (std::size_t k = 0; k + 2 * width <= numbers.accel[0].size(); k += width) {
    const Eigen::Vector3d before = mean(numbers.accel, k), after = mean(numbers.accel, k + width);
    if (std::abs(before.norm() / usual - 1.0) > 0.1 || std::abs(after.norm() / usual - 1.0) > 0.1) continue;
    const Eigen::Vector3d change = after.normalized() - before.normalized();
    if (change.norm() < 0.02 || change.norm() > 0.5) continue;
    const Eigen::Vector3d turn = -(mean(numbers.gyro, k + width / 2) * static_cast<double>(width) * period_s)
                                      .cross((before + after).normalized());
    both += change.dot(turn);
    turned += turn.squaredNorm();
    moved += change.squaredNorm();
    ++steps;
  }
  constexpr int fewest = 5;
  if (steps < fewest || turned == 0.0 || both * both < 0.5 * turned * moved) return {};
  return both / turned;
}

// ---- put together ----

class Proposer {
 public:
  Proposer(const ColumnSource& source, const ImportSite& site)
      : source_(source), path_(source.file_name), site_(site) {}

  Result<MapProposal> propose() {
    if (!source_.topic.empty()) return of_bag();
    if (source_.text)
      layout_ = TRY(look_at_text(*source_.text, path_));
    else
      for (const std::string& name : source_.names) layout_.columns.push_back({name, lower(name)});
    find_columns();
    if (!gyro_ || !accel_) return input_error(path_ + ": " + columns_missing());
    Numbers numbers = TRY(read());
    if (numbers.gyro[0].size() < 10)
      return input_error(fmt::format("{}: {} rows: expected at least 10", path_, numbers.gyro[0].size()));
    judge_time(numbers);
    judge_units(numbers);
    return MapProposal{text(numbers), doubts_};
  }

 private:
  void doubt(const std::string& what) { doubts_.push_back(what); }
  const std::string& label(std::size_t column) const { return layout_.columns[column].label; }

  MapProposal of_bag() const {
    std::string map =
        fmt::format("{} for {}.\n", proposed_beginning, source_.note) +
        "gyro.columns = angular_velocity.x, angular_velocity.y, angular_velocity.z\ngyro.unit = rad/s\n"
        "accel.columns = linear_acceleration.x, linear_acceleration.y, linear_acceleration.z\naccel.unit = m/s^2\n"
        "time.column = t\n";
    const bool plain =
        quoted(source_.topic).size() == source_.topic.size() + 2 && source_.topic.find('#') == std::string::npos;
    if (plain) map += "topic = " + source_.topic + "\n";
    if (source_.names.back() == "temperature") map += "temperature.column = temperature\n";
    return {map + site_lines(), {}};
  }

  void find_columns() {
    std::vector<std::string> others[2];
    for (const Triad& triad : triads_of(layout_.columns)) {
      const std::string& name = label(triad[0]);
      if (!is_accel(name) && !is_gyro(name)) continue;
      std::optional<Triad>& role = is_accel(name) ? accel_ : gyro_;
      if (!role) role = triad;
      if (label((*role)[0]) != name && layout_.named) others[is_accel(name) ? 1 : 0].push_back(quoted(name));
    }
    if (!others[0].empty())
      doubt(fmt::format("which gyros: {} or {}", quoted(label((*gyro_)[0])), fmt::join(others[0], ", ")));
    if (!others[1].empty())
      doubt(fmt::format("which accelerometers: {} or {}", quoted(label((*accel_)[0])), fmt::join(others[1], ", ")));
    for (std::size_t k = 0; k < layout_.columns.size(); ++k) {
      const std::string& name = label(k);
      const bool in_triad = (gyro_ && std::ranges::find(*gyro_, k) != gyro_->end()) ||
                            (accel_ && std::ranges::find(*accel_, k) != accel_->end());
      if (in_triad) continue;
      if (!time_ && (has_any(name, {"time", "stamp", "tow", "second"}) || name == "t" || name.starts_with("t_") ||
                     name.starts_with("t ") || name.starts_with("t[")))
        time_ = k;
      if (!temperature_ && name.find("temp") != name.npos) temperature_ = k;
    }
    // Columns that have no names but their place in one matrix.
    const std::size_t count = layout_.columns.size();
    const bool nameless = !layout_.named || std::ranges::all_of(layout_.columns, [&](const Candidate& column) {
      return column.reference.find_first_not_of("0123456789") == column.reference.npos ||
             column.reference.substr(0, column.reference.find(':') + 1) ==
                 layout_.columns[0].reference.substr(0, layout_.columns[0].reference.find(':') + 1);
    });
    if (gyro_ || accel_ || !nameless || (count != 6 && count != 7)) return;
    by_place_ = true;
    gyro_ = {0, 1, 2};
    accel_ = {3, 4, 5};
    if (count == 7) time_ = 6;
  }

  std::string columns_missing() const {
    std::vector<std::string> names;
    for (const Candidate& column : layout_.columns)
      names.push_back(quoted(column.label.empty() ? column.reference : column.label));
    names.resize(std::min<std::size_t>(names.size(), 20));
    return fmt::format(
        "no three columns that are plainly those of the {}: expected --map with their names; it has {} columns: {}",
        gyro_ ? "accelerometers" : "gyros", layout_.columns.size(), fmt::join(names, ", "));
  }

  Result<Numbers> read() {
    std::vector<WantedColumn> wanted;
    for (const Triad& triad : {*gyro_, *accel_})
      for (const std::size_t column : triad) wanted.push_back({layout_.columns[column].reference});
    if (time_) wanted.push_back({layout_.columns[*time_].reference});
    layout_.format.skip_bad_rows = true;  // whoever reads it in earnest says what is wrong with them
    NumberTable table = TRY(source_.read(wanted, layout_.format));
    if (by_place_) arrange(table);
    Numbers numbers;
    for (std::size_t k = 0; k < 3; ++k) {
      numbers.gyro[k] = std::move(table.columns[k]);
      numbers.accel[k] = std::move(table.columns[3 + k]);
    }
    if (time_) numbers.t = std::move(table.columns[6]);
    return numbers;
  }

  // Time first or last, and the accelerometers where gravity is.
  void arrange(NumberTable& table) {
    std::vector<std::size_t> order{0, 1, 2, 3, 4, 5, 6};
    const auto grows = [&](std::size_t k) {
      return std::ranges::is_sorted(table.columns[k], std::ranges::less_equal());
    };
    const auto& columns = table.columns;
    if (time_ && !grows(6) && grows(0)) std::ranges::rotate(order, order.begin() + 1);
    const auto scatter = [&](std::size_t at) {
      std::array<std::vector<double>, 3> triad{columns[order[at]], columns[order[at + 1]], columns[order[at + 2]]};
      std::vector<double> off;
      const double norm = middle_norm(triad);
      for (std::size_t k = 0; k < triad[0].size(); ++k)
        off.push_back(std::abs(std::hypot(triad[0][k], triad[1][k], triad[2][k]) - norm));
      return median(off) / norm;
    };
    if (scatter(0) < scatter(3)) std::swap_ranges(order.begin(), order.begin() + 3, order.begin() + 3);
    std::vector<std::vector<double>> arranged;
    for (std::size_t k = 0; k < columns.size(); ++k) arranged.push_back(std::move(table.columns[order[k]]));
    table.columns = std::move(arranged);
    for (std::size_t k = 0; k < 3; ++k) (*gyro_)[k] = order[k], (*accel_)[k] = order[3 + k];
    if (time_) time_ = order[6];
  }

  void judge_time(const Numbers& numbers) {
    if (!time_) {
      doubt("rate_hz: there is no column of times");
      return;
    }
    const double interval = typical_interval(numbers.t);
    struct Clock {
      std::string_view name;
      double second;
      std::initializer_list<std::string_view> words;
    };
    static const Clock clocks[] = {{"ns", 1e-9, {"ns", "nano"}},
                                   {"us", 1e-6, {"us", "micro"}},
                                   {"ms", 1e-3, {"ms", "milli"}},
                                   {"s", 1.0, {"_s", "[s", "(s", " s", "sec"}}};
    const Clock* by_name = nullptr;
    const Clock* by_rate = nullptr;
    for (const Clock& clock : clocks) {
      if (by_name == nullptr && has_any(label(*time_), clock.words)) by_name = &clock;
      if (interval * clock.second > 2e-4 && interval * clock.second < 5e-2) by_rate = &clock;
    }
    const Clock* const clock = by_name != nullptr ? by_name : by_rate;
    const std::string column = "time.column " + quoted(layout_.columns[*time_].reference);
    if (!(interval > 0.0)) doubt(column + " does not grow");
    if (clock == nullptr)
      doubt(fmt::format("{}: {} from row to row: neither s, ms, us nor ns of 20 to 5000 Hz", column, interval));
    if (by_name != nullptr && by_rate != nullptr && by_name != by_rate)
      doubt(fmt::format("{}: the header says {}, which is {:.4g} Hz; {} would be {:.4g} Hz", column, by_name->name,
                        1.0 / (interval * by_name->second), by_rate->name, 1.0 / (interval * by_rate->second)));
    time_unit_ = clock != nullptr ? clock->name : "s";
    period_s_ = interval * (clock != nullptr ? clock->second : 1.0);
  }

  void judge_units(const Numbers& numbers) {
    const double norm = middle_norm(numbers.accel);
    const std::string& accel_label = label((*accel_)[0]);
    const std::string& gyro_label = label((*gyro_)[0]);
    const Unit* const seen = accel_unit_by_norm(norm, period_s_);
    const bool increments = seen != nullptr ? !seen->is_rate : is_increment(accel_label);
    const Unit* const said = by_place_ ? nullptr : unit_in(accel_units, accel_label, !is_increment(accel_label));
    accel_unit_ = said != nullptr ? said->name : seen != nullptr ? seen->name : "m/s^2";
    if (seen == nullptr)
      doubt(
          fmt::format("accel.unit: the norm is {:.4g}, which is gravity in none of m/s^2, g, mg and m/s: a scale is "
                      "missing, or these are no accelerometers",
                      norm));
    else if (said != nullptr && said != seen)
      doubt(fmt::format("accel.unit: the header says {}, the norm of {:.4g} is gravity in {}", said->name, norm,
                        seen->name));
    const Unit* const gyro_said =
        by_place_ ? nullptr : unit_in(gyro_units, gyro_label, !(is_increment(gyro_label) || increments));
    const Unit* gyro_seen = nullptr;
    const std::optional<double> scale = period_s_ > 0.0 ? gyro_scale(numbers, period_s_) : std::nullopt;
    for (const Unit& unit : gyro_units)
      if (scale && unit.is_rate != increments &&
          std::abs(std::log(std::abs(*scale) * (increments ? period_s_ : 1.0) / unit.si)) < std::log(1.5))
        gyro_seen = &unit;
    gyro_unit_ = gyro_said != nullptr   ? gyro_said->name
                 : gyro_seen != nullptr ? gyro_seen->name
                 : increments           ? "rad"
                                        : "rad/s";
    if (gyro_said == nullptr && !scale)
      doubt(fmt::format("gyro.unit: the header does not say it, and {}", period_s_ > 0.0
                                                                             ? "the unit does not turn enough to tell"
                                                                             : "without a rate the numbers do not"));
    else if (scale && (gyro_seen == nullptr || (gyro_said != nullptr && gyro_said != gyro_seen)))
      doubt(fmt::format("gyro.unit: gravity turns as if a number were {:.3g} rad/s{}: {}", *scale,
                        gyro_said == nullptr ? "" : fmt::format(" and the header says {}", gyro_said->name),
                        gyro_seen == nullptr ? "a unit or a scale that is not known here" : gyro_seen->name));
    if (scale && *scale < 0.0)
      doubt(
          "gyro.axes, accel.axes: gravity turns against the gyros: signs or axes of one triad are others, or the "
          "accelerometers read gravity and not specific force");
  }

  std::string site_lines() const {
    return fmt::format(
        "gravity_mps2 = {}{}\nlatitude_deg = {}\nunit_serial = {}\n", format_number(site_.gravity_mps2),
        site_.gravity_mps2 == ImportSite{}.gravity_mps2 ? "  # the standard one: --gravity gives the site's" : "",
        format_number(site_.latitude_deg), site_.unit_serial);
  }

  std::string text(const Numbers& numbers) const {
    const auto three = [&](const Triad& triad) {
      return fmt::format("{}, {}, {}", layout_.columns[triad[0]].reference, layout_.columns[triad[1]].reference,
                         layout_.columns[triad[2]].reference);
    };
    std::string map = fmt::format("{} for {}: {} rows", proposed_beginning, quoted(path_), numbers.gyro[0].size());
    if (period_s_ > 0.0) map += fmt::format(" at {:.6g} Hz", 1.0 / period_s_);
    map += ".\n";
    for (const std::string& what : doubts_) map += "# In doubt: " + what + "\n";
    map += fmt::format("gyro.columns = {}\ngyro.unit = {}\naccel.columns = {}\naccel.unit = {}\n", three(*gyro_),
                       gyro_unit_, three(*accel_), accel_unit_);
    map += time_ ? fmt::format("time.column = {}\ntime.unit = {}\n", layout_.columns[*time_].reference, time_unit_)
                 : "rate_hz = 100\n";
    if (temperature_) map += fmt::format("temperature.column = {}\n", layout_.columns[*temperature_].reference);
    const char delimiter = layout_.format.delimiter;
    if (delimiter != ',')
      map += fmt::format("csv.delimiter = {}\n", delimiter == ';' ? "semicolon" : delimiter == '\t' ? "tab" : "space");
    if (layout_.format.header_lines != 1) map += fmt::format("csv.header_lines = {}\n", layout_.format.header_lines);
    return map + site_lines();
  }

  const ColumnSource& source_;
  const std::string& path_;
  const ImportSite& site_;
  Layout layout_;
  std::optional<Triad> gyro_, accel_;
  std::optional<std::size_t> time_, temperature_;
  bool by_place_ = false;
  double period_s_ = 0.0;
  std::string_view time_unit_ = "s", gyro_unit_, accel_unit_;
  std::vector<std::string> doubts_;
};

}  // namespace

Result<MapProposal> propose_map(const ColumnSource& source, const ImportSite& site) {
  return Proposer(source, site).propose();
}

}  // namespace turncal
