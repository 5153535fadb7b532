#include "imu_io/recordings/map_proposal.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <optional>
#include <span>

#include "calib/model/parameters.h"
#include "calib/statistics/numerics.h"
#include "calib/statistics/unit_slip.h"
#include "imu_io/base/clock.h"
#include "imu_io/base/text.h"
#include "imu_io/recordings/recording_check.h"
#include "imu_io/recordings/stamps.h"

namespace turncal {
namespace {

using Numbers = std::vector<double>;
using Triad = std::array<std::size_t, 3>;  // columns

// A column: its name in a map, its text in the header, in small letters and with units in ASCII, and its name as written.
struct Candidate {
  std::string reference, label, said;
};
struct Layout {
  TableFormat format;
  std::vector<Candidate> columns;
  std::string unnamed;  // why the header gives no names
};

// Returns whether the text has one of the words. ^word begins the text, or a name in a group or struct; no letter follows word$.
bool has_any(std::string_view text, const std::vector<std::string_view>& words) {
  const std::size_t parent = text.substr(0, std::min(text.size(), text.find_first_of(" [("))).find_last_of("/.:");
  const std::string_view name = text.substr(parent == text.npos ? 0 : parent + 1);
  return std::ranges::any_of(words, [&](std::string_view word) {
    if (word.starts_with('^')) return text.starts_with(word.substr(1)) || name.starts_with(word.substr(1));
    const bool ends = word.ends_with('$');
    if (ends) word.remove_suffix(1);
    for (std::size_t at = 0; (at = text.find(word, at)) != text.npos; at += word.size())
      if (const std::string_view rest = text.substr(at + word.size());
          !ends || rest.empty() || rest[0] < 'a' || rest[0] > 'z')
        return true;
    return false;
  });
}

std::string lower(std::string_view said) {
  std::string text = ascii_units(said);
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? char(c + 32) : c;
  return text;
}

std::vector<std::string_view> cells_of(std::string_view line, char delimiter) {
  std::vector<std::string_view> cells;
  split_cells(line, delimiter, cells);
  return cells;
}

// Finds where the numbers of a text begin, what separates them, and the names above them.
Result<Layout> look_at_text(std::string_view text, const std::string& file_name) {
  TRY(check_text(text, file_name));
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  std::vector<std::string_view> lines;
  while (lines.size() < 200 && !text.empty())
    if (const std::string_view line = next_line(text); !line.starts_with("//")) lines.push_back(line);
  Layout layout;
  constexpr std::ptrdiff_t fewest = 6;
  std::ptrdiff_t most = fewest - 1;
  for (const bool comma : {false, true})
    for (const char delimiter : {',', ';', '\t', ' '})
      for (std::size_t k = 0; k < lines.size(); ++k) {
        const auto is_number = [&](std::string_view cell) { return device_number(cell, comma).has_value(); };
        const auto numbers = std::ranges::count_if(cells_of(lines[k], delimiter), is_number);
        if (numbers <= most) continue;
        most = numbers;
        layout.format = {.delimiter = delimiter, .decimal_comma = comma, .header_lines = int(k)};
      }
  if (most < fewest) return input_error(file_name + ": no row of six numbers or more: expected a table of an IMU");
  const auto first = std::size_t(layout.format.header_lines);
  const auto used = [](std::vector<std::string_view> cells) {
    while (!cells.empty() && cells.back().empty()) cells.pop_back();
    return cells;
  };
  const std::vector<std::string_view> row = cells_of(lines[first], layout.format.delimiter);
  const std::size_t width = row.size(), fewest_names = used(row).size();
  const auto header = [&](std::size_t above) {
    std::string_view line = first >= above ? trimmed(lines[first - above]) : std::string_view();
    while (line.starts_with('#') || line.starts_with('%')) line = trimmed(line.substr(1));
    std::vector<std::string_view> cells = used(cells_of(line, layout.format.delimiter));
    const bool fits = cells.size() >= fewest_names && cells.size() <= width;
    if (!fits && cells.size() > 2)
      layout.unnamed = fmt::format(" (line {} has {} names, a row {} cells)", first + 1 - above, cells.size(), width);
    if (!fits) cells.clear();
    cells.resize(width);
    return cells;
  };
  const bool units_below = header(1)[0].starts_with('(');
  const std::vector<std::string_view> names = header(units_below ? 2 : 1);
  for (std::size_t k = 0; k < width; ++k) {
    const std::string name(names[k]);
    const bool plain = !units_below && is_plain_text(name) && name.find_first_of(",=") == name.npos &&
                       std::ranges::count(names, name) == 1;
    const std::string label =
        parse_time_stamp(row[k]) ? "time [s]" : name + (units_below ? " " + std::string(header(1)[k]) : "");
    // A column that is empty in the row with the most numbers is named only.
    layout.columns.push_back({plain ? name : std::to_string(k + 1), row[k].empty() ? "" : lower(label), name});
  }
  return layout;
}

// Returns every three columns whose labels differ only in x, y and z; of the other columns, only in 1, 2 and 3, or 0, 1 and 2.
std::vector<Triad> triads_of(const std::vector<Candidate>& columns) {
  std::vector<Triad> triads;
  for (const std::string_view letters : {"xyz", "123", "012"})
    for (std::size_t i = 0; i < columns.size(); ++i)
      for (std::size_t at = 0; (at = columns[i].label.find(letters[0], at)) != std::string::npos; ++at) {
        Triad triad{i, i, i};
        std::string label = columns[i].label;
        for (std::size_t k = 1; k < 3; ++k) {
          label[at] = letters[k];
          triad[k] = std::size_t(std::ranges::find(columns, label, &Candidate::label) - columns.begin());
        }
        const auto has_one = [&](const Triad& other) {
          return std::ranges::any_of(triad, [&](std::size_t k) { return std::ranges::find(other, k) != other.end(); });
        };
        if (std::max(triad[1], triad[2]) < columns.size() && std::ranges::none_of(triads, has_one))
          triads.push_back(triad);
      }
  return triads;
}

struct Unit {
  std::string_view name;
  double si;
  bool is_rate;
  std::vector<std::string_view> words;  // in a header
};
constexpr double degph = rad_per_deg / 3600.0;
const std::vector<Unit> gyro_units = {{"deg/h", degph, true, {"deg/h", "degph", "dph"}},
                                      {"arcsec", degph, false, {"arcsec"}},
                                      {"mrad/s", 1e-3, true, {"mrad"}},
                                      {"mdeg/s", 1e-3 * rad_per_deg, true, {"mdps", "mdeg"}},
                                      {"rad/s", 1.0, true, {"rad"}},
                                      {"rad", 1.0, false, {"rad"}},
                                      {"deg/s", rad_per_deg, true, {"deg", "dps"}},
                                      {"deg", rad_per_deg, false, {"deg"}}};
const std::vector<Unit> accel_units = {
    {"cm/s^2", 1e-2, true, {"cm/s^2", "cm/s2", "cmps2", "cm s^-2", "cm.s^-2", "(gal", "[gal"}},
    {"m/s^2", 1.0, true, {"m/s^2", "m/s2", "mps2", "m s^-2", "m.s^-2"}},
    {"m/s", 1.0, false, {"m/s", "mps"}},
    {"mg", 9.80665e-3, true, {"_mg", "[mg", "(mg"}},
    {"g", 9.80665, true, {"_g", "[g", "(g"}}};

const std::vector<Unit> time_units = {{"ns", 1e-9, false, {"ns$", "nsec", "nano"}},
                                      {"us", 1e-6, false, {"us$", "usec", "micro"}},
                                      {"ms", 1e-3, false, {"ms$", "msec", "milli"}},
                                      {"s", 1.0, false, {"_s$", "[s$", "(s$", " s$", "sec"}}};

template <class Is>
const Unit* find_unit(const std::vector<Unit>& units, Is is) {
  const auto at = std::ranges::find_if(units, is);
  return at == units.end() ? nullptr : &*at;
}

const std::vector<std::string_view> no_sensor = {"mag", "bias", "cov", "std", "free"};
bool is_increment(std::string_view label) { return has_any(label, {"delta", "dtheta", "dang", "dvel", "^dv"}); }
bool is_gyro(std::string_view label) {
  return !has_any(label, no_sensor) &&
         has_any(label, {"gyr", "angular_vel", "angvel", "omega", "theta", "dang", "delta_ang", "deltaang", "ang_vel",
                         "rate", "^w", "^gx", "^g_", "^g1"});
}
bool is_accel(std::string_view label) {
  return !has_any(label, no_sensor) && has_any(label, {"acc", "specific", "force", "^dv", "dvel", "delta_v", "deltav",
                                                       "^a_", "^ax", "^a1", "^f_", "^fx", "^f1", "^f:", "^a:"});
}

// Whether a thermometer's name has nothing in it but itself, the unit and its sensors.
bool names_no_other_thing(std::string_view label) {
  constexpr std::string_view known[] = {
      "temperature", "temperatur", "temp",   "imu",        "gyroscope", "gyro",     "gyr",  "accelerometer",
      "accel",       "acc",        "sensor", "die",        "chip",      "internal", "mems", "unit",
      "deg",         "celsius",    "kelvin", "fahrenheit", "data",      "c",        "k",    "f",
      "t",           "s"};
  while (!label.empty()) {
    const auto word = std::ranges::find_if(known, [&](std::string_view w) { return label.starts_with(w); });
    const bool begins_word = std::isalpha(static_cast<unsigned char>(label[0])) != 0;
    if (begins_word && word == std::end(known)) return false;
    label.remove_prefix(begins_word ? word->size() : 1);
  }
  return true;
}

// ---- what the numbers say ----

Numbers norms_of(const std::array<const Numbers*, 3>& triad) {
  Numbers norms(triad[0]->size());
  for (std::size_t k = 0; k < norms.size(); ++k) norms[k] = std::hypot((*triad[0])[k], (*triad[1])[k], (*triad[2])[k]);
  return norms;
}

// ---- put together ----

class Proposer {
 public:
  Proposer(const ColumnSource& source, const ImportSite& site) : source_(source), site_(site) {}

  Result<MapProposal> propose() {
    for (const std::string& name : source_.names) {
      const char* const unit = name.starts_with("angular")  ? " [rad/s]"
                               : name.starts_with("linear") ? " [m/s^2]"
                                                            : " [s]";
      layout_.columns.push_back({name, lower(name) + (source_.topic.empty() ? "" : unit), name});  // of sensor_msgs/Imu
    }
    if (source_.head) layout_ = TRY(look_at_text(*source_.head, source_.file_name));
    find_columns();
    if (!by_place_ && (triad_[gyro].empty() || triad_[accel].empty())) return columns_missing();
    TRY(read());
    if (by_place_) place();
    judge_time();
    judge_units();
    judge_life();
    judge_temperature();
    judge_doubles();
    return MapProposal{text(), doubts_};
  }

 private:
  enum Role { gyro, accel };
  const std::string& label(Role role) const { return layout_.columns[triad_[role][0]].label; }
  const std::string& said(Role role) const { return layout_.columns[triad_[role][0]].said; }
  const std::string& reference(std::size_t column) const { return layout_.columns[column].reference; }
  std::array<const Numbers*, 3> numbers(Role role) const {
    return {&values_[triad_[role][0]], &values_[triad_[role][1]], &values_[triad_[role][2]]};
  }
  std::size_t rows() const { return std::ranges::max(values_, {}, &Numbers::size).size(); }
  template <class... Args>
  void doubt(fmt::format_string<Args...> words, Args&&... args) {
    doubts_.push_back(fmt::format(words, std::forward<Args>(args)...));
  }

  void find_columns() {
    std::vector<std::string> others[2];
    std::vector<std::size_t> taken, thermometers;
    for (const Triad& triad : triads_of(layout_.columns)) {
      const std::string& name = layout_.columns[triad[0]].label;
      if (!is_accel(name) && !is_gyro(name)) continue;
      const Role role = is_accel(name) ? accel : gyro;
      if (triad_[role].empty())
        triad_[role].assign(triad.begin(), triad.end());
      else
        others[role].push_back(quoted(layout_.columns[triad[0]].said));
      taken.insert(taken.end(), triad.begin(), triad.end());
    }
    for (const Role role : {gyro, accel})
      if (!others[role].empty())
        doubt("which {}: {} or {}", role == gyro ? "gyros" : "accelerometers", quoted(said(role)),
              fmt::join(others[role], ", "));
    for (const Role role : {gyro, accel})
      if (!triad_[role].empty())
        if (const auto alike = std::ranges::count(layout_.columns, label(role), &Candidate::label); alike > 1)
          doubt("which {}: {} columns are named {}", role == gyro ? "gyros" : "accelerometers", alike,
                quoted(said(role)));
    for (std::size_t k = layout_.columns.size(); k-- > 0;) {
      const std::string& name = layout_.columns[k].label;
      if (std::ranges::find(taken, k) != taken.end()) continue;
      const bool warm = has_any(name, {"temp", "^t_c", "degc", "celsius"});
      if (warm) thermometers.push_back(k);
      if (warm) continue;
      if (name == "t" || name.ends_with("/t") || name.ends_with(".t") || name.ends_with(":t") ||
          has_any(name,
                  {"time", "stamp", "tow", "epoch", "clock", "elapsed", "^t(", "second", "^sec", "^t_", "^t ", "^t["}))
        time_ = k;
    }
    find_thermometer(thermometers);
    find_nanoseconds();
    // The columns of a matrix that has no others.
    const std::string& front = layout_.columns.empty() ? std::string() : reference(0);
    const std::string matrix = front.substr(0, front.find(':') + 1);
    by_place_ =
        taken.empty() && (layout_.columns.size() == 6 || layout_.columns.size() == 7) &&
        std::ranges::all_of(layout_.columns, [&](const Candidate& c) {
          return c.reference.starts_with(matrix) && parse_integer(std::string_view(c.reference).substr(matrix.size()));
        });
  }

  // The one that names the unit or a sensor of it, else the only one that names no other thing.
  void find_thermometer(std::vector<std::size_t> columns) {
    if (columns.empty()) return;
    std::ranges::reverse(columns);
    const auto label_of = [this](std::size_t k) -> std::string_view { return layout_.columns[k].label; };
    const auto names_sensor = [](std::string_view name) {
      return names_no_other_thing(name) && has_any(name, {"imu", "gyr", "acc"});
    };
    const auto own = std::ranges::find_if(columns, names_sensor, label_of);
    const auto bare = std::ranges::find_if(columns, names_no_other_thing, label_of);
    temperature_ = own != columns.end() ? *own : bare != columns.end() ? *bare : columns.front();
    if (own != columns.end() || std::ranges::count_if(columns, names_no_other_thing, label_of) == 1) return;
    std::vector<std::string> names;
    for (const std::size_t k : columns) names.push_back(quoted(layout_.columns[k].said));
    doubt("which temperature is the unit's: {}", fmt::join(names, ", "));
  }

  // Finds seconds with the nanoseconds in them, as in a std_msgs/Header.
  void find_nanoseconds() {
    for (const std::string_view word : {"nanosec", "nsec"})
      for (std::size_t k = 0; k < layout_.columns.size(); ++k) {
        std::string label = layout_.columns[k].label;
        if (const std::size_t at = label.rfind(word); at != label.npos) label.replace(at, word.size(), "sec");
        const auto whole = std::ranges::find(layout_.columns, label, &Candidate::label) - layout_.columns.begin();
        if (label != layout_.columns[k].label && whole < std::ssize(layout_.columns))
          time_ = std::size_t(whole), nanoseconds_ = k;
      }
  }

  Error columns_missing() const {
    std::vector<std::string> names;
    for (const auto& [reference, label, said] : layout_.columns)
      names.push_back(quoted(reference) +
                      (said.empty() || said == reference ? "" : fmt::format(" ({})", quoted(said))));
    names.resize(std::min<std::size_t>(names.size(), 20));
    return input_error(
        "{}: no three columns can be recognised as the {}: expected --map with their names; the columns are {}",
        source_.file_name, triad_[gyro].empty() ? "gyros" : "accelerometers",
        names.empty() ? "none" : fmt::format("{}{}", fmt::join(names, ", "), layout_.unnamed));
  }

  Status read() {
    std::vector<std::size_t> columns(triad_[gyro]);
    columns.insert(columns.end(), triad_[accel].begin(), triad_[accel].end());
    for (const auto& column : {time_, nanoseconds_, temperature_})
      if (column) columns.push_back(*column);
    for (std::size_t k = 0; by_place_ && k < layout_.columns.size(); ++k) columns.push_back(k);
    std::vector<WantedColumn> wanted;
    for (const std::size_t column : columns) wanted.push_back({reference(column), column == temperature_});
    layout_.format.skip_bad_rows = true;  // the import reports them
    NumberTable table;
    TRY(source_.read(wanted, layout_.format, [&](const NumberTable& block) {
      append_rows(table, block);
      return Status();
    }));
    if (table.rows() < 10)
      return input_error("{}: {} with a number in each column of the IMU: expected at least 10{}{}", source_.file_name,
                         counted(table.rows(), "row"), table.bad_rows > 0 ? "; " : "", table.first_bad);
    values_.resize(layout_.columns.size());
    for (std::size_t k = 0; k < columns.size(); ++k) values_[columns[k]] = std::move(table.columns[k]);
    for (std::size_t k = rows(); nanoseconds_ && k-- > 0;)
      values_[*time_][k] += 1e-9 * values_[*nanoseconds_][k] - values_[*time_][0];
    return {};
  }

  // Takes the first or last column as the time. Which triad has gravity is seen later.
  void place() {
    const bool timed = values_.size() == 7;
    const bool first =
        timed && std::ranges::is_sorted(values_[0], std::ranges::less_equal()) && !std::ranges::is_sorted(values_[6]);
    if (timed) time_ = first ? 0 : 6;
    const std::size_t at = first ? 1 : 0;
    triad_[gyro] = {at, at + 1, at + 2};
    triad_[accel] = {at + 3, at + 4, at + 5};
  }

  void judge_time() {
    if (site_.rate_hz > 0.0) time_.reset(), period_s_ = 1.0 / site_.rate_hz;
    if (!time_)
      return period_s_ > 0.0 ? void() : doubt("there is no column of times (--rate gives the samples a second)");
    const std::span<const double> times(values_[*time_]);
    const StampModel stamps = fit_stamps(times.first(std::min<std::size_t>(times.size(), 1 << 15)));
    const double interval = stamps.period;
    jitter_ = stamps.scatter > even_scatter ? stamps.scatter * interval : 0.0;
    const Unit *said = nullptr, *seen = nullptr;
    for (const Unit& clock : time_units) {
      if (said == nullptr && has_any(layout_.columns[*time_].label, clock.words)) said = &clock;
      if (interval * clock.si > 1.9e-4 && interval * clock.si < 0.17) seen = &clock;
    }
    if (said == nullptr && seen == nullptr)
      doubt("time.column {}: {:.4g} from row to row is no rate of 6 to 5000 Hz in s, ms, us or ns",
            quoted(reference(*time_)), interval);
    else if (said != nullptr && seen != nullptr && said != seen)
      doubt("time.unit: the header says {}, which is {:.4g} Hz; in {} it is {:.4g} Hz", said->name,
            1.0 / (interval * said->si), seen->name, 1.0 / (interval * seen->si));
    const Unit& clock = said != nullptr ? *said : seen != nullptr ? *seen : time_units.back();
    time_unit_ = clock.name;
    time_guessed_ = said == nullptr && seen != nullptr;
    period_s_ = interval * clock.si;
  }

  // Returns the units in which the norm is mostly gravity.
  std::vector<const Unit*> gravity_in(Role role, double& norm) const {
    Numbers norms = norms_of(numbers(role));
    norm = median(norms);
    std::vector<const Unit*> found;
    for (const Unit& unit : accel_units)
      if (std::abs(norm * unit.si / (unit.is_rate ? 1.0 : period_s_) / 9.80665 - 1.0) < slip_nearness)
        found.push_back(&unit);
    return found;
  }

  void judge_units() {
    double norm = 0.0;
    if (by_place_ && gravity_in(accel, norm).empty() && !gravity_in(gyro, norm).empty())
      std::swap(triad_[gyro], triad_[accel]);
    const std::vector<const Unit*> gravities = gravity_in(accel, norm);
    const Unit* seen = gravities.empty() ? nullptr : gravities.front();
    const auto said_of = [&](Role role, const std::vector<Unit>& units, bool is_rate) {
      return find_unit(units, [&](const Unit& unit) {
        return !by_place_ && unit.is_rate == is_rate && has_any(label(role), unit.words) &&
               !has_any(label(role), {"urad", "milli", "/min"});
      });
    };
    const Unit* said = said_of(accel, accel_units, !is_increment(label(accel)));
    if (std::ranges::find(gravities, said) != gravities.end()) seen = said;
    if (seen == nullptr)
      doubt(
          "accel.unit: the norm of {:.4g} is within 12 % of gravity in none of m/s^2, cm/s^2, g, mg and m/s: a scale "
          "is missing, or these are no accelerometers",
          norm);
    else if (said == nullptr && gravities.size() > 1)
      doubt("accel.unit: the norm of {:.4g} is gravity in {} and in {}", norm, seen->name, gravities[1]->name);
    else if (said != nullptr && said != seen)
      doubt("accel.unit: the header says {}, the norm of {:.4g} is gravity in {}", said->name, norm, seen->name);
    unit_[accel] = said != nullptr ? said->name : seen != nullptr ? seen->name : "m/s^2";
    Numbers norms = norms_of(numbers(accel));
    for (std::size_t quarter = 0; quarter < 4; ++quarter) {
      const auto part = std::span(norms).subspan(quarter * (norms.size() / 4), norms.size() / 4);
      if (const double here = median(part); std::abs(here / norm - 1.0) > roughest_scale)
        doubt("accel.columns: the norm is {:.4g} in all, and {:.4g} in the {}. quarter of the record", norm, here,
              quarter + 1);
    }
    const bool rates = seen != nullptr ? seen->is_rate : !is_increment(label(gyro));
    const std::optional<GyroMap> turns = gyro_map(period_s_ > 0.0 ? rows() : 0, [&](std::size_t k) {
      const std::array w = numbers(gyro), f = numbers(accel);
      return MotionSums{period_s_, period_s_ * Eigen::Vector3d((*w[0])[k], (*w[1])[k], (*w[2])[k]),
                        period_s_ * Eigen::Vector3d((*f[0])[k], (*f[1])[k], (*f[2])[k])};
    });
    if (time_guessed_ && !turns)
      doubt("time.unit: the header does not say it, and the unit does not turn enough to tell; in {} it is {:.4g} Hz",
            time_unit_, 1.0 / period_s_);
    seen = find_unit(gyro_units, [&](const Unit& unit) {
      return turns && unit.is_rate == rates &&
             std::abs(std::log(turns->factor * (rates ? 1.0 : period_s_) / unit.si)) < std::log1p(roughest_motion);
    });
    said = said_of(gyro, gyro_units, rates);
    const bool says_rate = has_any(label(gyro), {"/s", "ps", "s^-1", "s-1", "_s", " s", "/h", "ph"});
    if (!turns && period_s_ > 0.0 && (said == nullptr || (rates && !says_rate)))
      doubt("gyro.unit: the header {}, and the unit does not turn enough to tell",
            said == nullptr ? "does not say it" : "says no rate");
    else if (turns && (seen == nullptr || (said != nullptr && said != seen)))
      doubt("gyro.unit: gravity turns as if a number were {:.3g} rad/s{}{}", turns->factor,
            seen == nullptr ? "" : fmt::format(", which is {}", seen->name),
            said == nullptr ? "" : fmt::format("; the header says {}", said->name));
    if (turns && !turns->axes.isIdentity())
      doubt("gyro.axes, accel.axes: gravity turns against the gyros: axes or signs are others");
    unit_[gyro] = said != nullptr ? said->name : seen != nullptr ? seen->name : rates ? "rad/s" : "rad";
  }

  // A gyro that reads 0 throughout is not connected if another one reads something.
  void judge_life() {
    const auto is_dead = [&](std::size_t column) {
      return std::ranges::count(values_[column], 0.0) == std::ssize(values_[column]);
    };
    if (std::ranges::all_of(triad_[gyro], is_dead)) return;
    for (const std::size_t column : triad_[gyro])
      if (is_dead(column)) doubt("gyro.columns: {} is 0 throughout", quoted(reference(column)));
  }

  // The unit by the header; in which a unit can be.
  void judge_temperature() {
    constexpr double lowest_c = -60.0, highest_c = 150.0;
    if (!temperature_) return;
    const std::string& name = layout_.columns[*temperature_].label;
    const bool kelvin = has_any(name, {"[k]", "(k)", "kelvin"}) || name.ends_with("_k"),
               fahrenheit = has_any(name, {"[f]", "(f)", "fahr", "degf"}) || name.ends_with("_f");
    if (kelvin) temperature_lines_ = "temperature.offset = 273.15\n";
    if (fahrenheit) temperature_lines_ = "temperature.offset = 32\ntemperature.scale = 0.5555555555555556\n";
    Numbers read = values_[*temperature_];
    std::erase_if(read, [](double x) { return std::isnan(x); });
    if (read.empty()) return;
    const double usual = median(read), usual_c = kelvin ? usual - 273.15 : fahrenheit ? (usual - 32.0) / 1.8 : usual;
    if (!(usual_c >= lowest_c && usual_c <= highest_c))
      doubt("temperature.scale, temperature.offset: a reading of {:.6g} is {:.6g} C", usual, usual_c);
  }

  // Rows that repeat a stamp are another unit's if their numbers differ, always in the same direction, from the rows before and behind.
  void judge_doubles() {
    constexpr double chance = 8.0, fewest = 20.0;
    if (!time_) return;
    const Numbers& time = values_[*time_];
    for (const Role role : {gyro, accel})
      for (const Numbers* x : numbers(role)) {
        double n = 0.0, sum = 0.0, squares = 0.0;
        for (std::size_t k = 1; k + 1 < time.size(); ++k) {
          if (time[k] != time[k - 1] || time[k + 1] == time[k]) continue;
          const double bend = 2.0 * (*x)[k] - (*x)[k - 1] - (*x)[k + 1];
          n += 1.0, sum += bend, squares += bend * bend;
        }
        if (n >= fewest && sum * sum > chance * chance * (squares - sum * sum / n))
          return doubt(
              "time.column: {:g} rows have the stamp of the row before, and are another unit's by their numbers", n);
      }
  }

  std::string site_lines() const {
    const char* const standard =
        site_.gravity_mps2 == ImportSite{}.gravity_mps2 ? "  # the standard one: --gravity gives the site's" : "";
    return fmt::format("gravity_mps2 = {}{}\nlatitude_deg = {}\nunit_serial = {}\n", format_number(site_.gravity_mps2),
                       standard, format_number(site_.latitude_deg), site_.unit_serial);
  }

  std::string text() const {
    std::string map = fmt::format("{} for {}: {} rows{}.\n", proposed_beginning, quoted(source_.file_name), rows(),
                                  period_s_ > 0.0 ? fmt::format(" at {:.6g} Hz", 1.0 / period_s_) : "");
    if (time_)
      map +=
          jitter_ > 0.0 ? fmt::format("# Jitter: {:.2g} {} rms.\n", jitter_, time_unit_) : "# The stamps are even.\n";
    for (const std::string& what : doubts_) map += "# In doubt: " + what + "\n";
    for (const Role role : {gyro, accel}) {
      const char* const name = role == gyro ? "gyro" : "accel";
      map += fmt::format("{}.columns = {}, {}, {}\n{}.unit = {}\n", name, reference(triad_[role][0]),
                         reference(triad_[role][1]), reference(triad_[role][2]), name, unit_[role]);
    }
    map += nanoseconds_
               ? fmt::format("time.column = {}, {}\ntime.unit = s, ns\n", reference(*time_), reference(*nanoseconds_))
           : time_ ? fmt::format("time.column = {}\ntime.unit = {}\n", reference(*time_), time_unit_)
                   : fmt::format("rate_hz = {}\n", format_number(site_.rate_hz > 0.0 ? site_.rate_hz : 100.0));
    if (temperature_) map += fmt::format("temperature.column = {}\n{}", reference(*temperature_), temperature_lines_);
    if (const std::string& t = source_.topic; !t.empty() && quoted(t) == "'" + t + "'" && t.find('#') == t.npos)
      map += "topic = " + source_.topic + "\n";
    const TableFormat& format = layout_.format;
    if (format.delimiter != ',')
      map += fmt::format("csv.delimiter = {}\n", format.delimiter == ';'    ? "semicolon"
                                                 : format.delimiter == '\t' ? "tab"
                                                                            : "space");
    if (format.decimal_comma) map += "csv.decimal = comma\n";
    if (format.header_lines != 1) map += fmt::format("csv.header_lines = {}\n", format.header_lines);
    return map + site_lines();
  }

  const ColumnSource& source_;
  const ImportSite& site_;
  Layout layout_;
  std::vector<Numbers> values_;  // by column, of those that are read
  std::array<std::vector<std::size_t>, 2> triad_;
  std::optional<std::size_t> time_, nanoseconds_, temperature_;
  bool by_place_ = false, time_guessed_ = false;
  double jitter_ = 0.0, period_s_ = 0.0;  // of the stamps, in the unit of the file
  std::string_view time_unit_ = "s", temperature_lines_;
  std::array<std::string_view, 2> unit_;
  std::vector<std::string> doubts_;
};

}  // namespace

Result<MapProposal> propose_map(const ColumnSource& source, const ImportSite& site) {
  return Proposer(source, site).propose();
}

}  // namespace turncal
