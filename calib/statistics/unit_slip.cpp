#include "calib/statistics/unit_slip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "calib/model/attitude.h"
#include "calib/model/parameters.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

// Returns the rate, in increments per second, of the rest before block `end`: the Earth's, and biases that reach degrees in the time of a turn.
Eigen::Vector3d rate_at_rest(const std::vector<Block>& blocks, std::size_t end) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double t = 0.0;
  for (std::size_t k = end; k > 0 && blocks[k - 1].segment == blocks[end - 1].segment; --k) {
    if (!blocks[k - 1].whole_second) continue;
    sum += blocks[k - 1].gyro;
    t += blocks[k - 1].duration_s;
  }
  return t > 0.0 ? (sum / t).eval() : sum;
}

constexpr UnitSlip of_accelerometers[] = {
    {1.0 / standard_gravity_mps2, "as if they were in g, not m/s^2"},
    {standard_gravity_mps2, "as if they were in m/s^2, not g"},
    {1000.0 / standard_gravity_mps2, "as if they were in mg, not m/s^2"},
    {standard_gravity_mps2 / 1000.0, "as if they were in m/s^2, not mg"},
    {2.0, "too large by 2: the range, or the rate, is another"},
    {0.5, "too small by 2: the range, or the rate, is another"},
};
constexpr UnitSlip of_gyros[] = {
    {1.0 / rad_per_deg, "as if they were in deg/s, not rad/s"},
    {rad_per_deg, "as if they were in rad/s, not deg/s"},
    {2.0, "too large by 2: the range, or the rate, is another"},
    {0.5, "too small by 2: the range, or the rate, is another"},
};

std::string wrong_gyros(const CompressedRecording& recording) {
  const double ratio = felt_of_commanded(recording);
  const UnitSlip* const slip = slip_near(gyro_slips(), ratio);
  if (slip == nullptr) return {};
  return fmt::format("in the table's turns the gyros add up to {:.4g} times what is expected: {}", ratio, slip->words);
}

}  // namespace

std::vector<TableTurn> table_turns(const CompressedRecording& recording) {
  constexpr double least_turn_deg = 20.0;
  const double gyro_rad = nominal_gyro_rad(recording.info);
  const std::vector<Block>& blocks = recording.blocks;
  std::vector<TableTurn> turns;
  for (std::size_t first = 0, end = 0; first < blocks.size(); first = end) {
    const std::size_t segment = blocks[first].segment;
    Eigen::Vector3d felt = Eigen::Vector3d::Zero();
    double felt_s = 0.0;
    for (end = first; end < blocks.size() && blocks[end].segment == blocks[first].segment; ++end) {
      felt += blocks[end].gyro;
      felt_s += blocks[end].duration_s;
    }
    felt -= felt_s * rate_at_rest(blocks, first);
    if (segment == 0 || recording.segments[segment].kind != SegmentKind::rotate) continue;
    const Segment &from = recording.segments[segment - 1], &to = recording.segments[segment];
    const std::array<double, 3> by = {std::abs(to.heading_deg - from.heading_deg),
                                      std::abs(to.pitch_deg - from.pitch_deg), std::abs(to.roll_deg - from.roll_deg)};
    const double sum = by[0] + by[1] + by[2];
    const bool one_axis = by[0] == sum || by[1] == sum || by[2] == sum;
    if (one_axis && sum >= least_turn_deg) turns.push_back({first, end, sum * rad_per_deg, gyro_rad * felt});
  }
  return turns;
}

double felt_of_commanded(const CompressedRecording& recording) {
  std::vector<double> ratios;
  for (const TableTurn& turn : table_turns(recording)) ratios.push_back(turn.felt_rad() / turn.commanded_rad);
  return ratios.size() < 3 ? std::numeric_limits<double>::quiet_NaN() : median(ratios);
}

std::span<const UnitSlip> accel_slips() { return of_accelerometers; }
std::span<const UnitSlip> gyro_slips() { return of_gyros; }

const UnitSlip* slip_near(std::span<const UnitSlip> slips, double ratio) {
  for (const UnitSlip& slip : slips)
    if (std::abs(ratio / slip.factor - 1.0) < slip_nearness) return &slip;
  return nullptr;
}

std::string wrong_gravity(double ratio, const RecordingInfo& info) {
  // The nominal weight of a pulse may be off by more than a scale factor; a factor of two shows.
  const double far = info.accel_increment == IncrementKind::pulses ? 1.8 : 1.0 + roughest_scale;
  const bool is_far = ratio >= far || ratio <= 1.0 / far;
  if (info.accel_increment == IncrementKind::pulses)
    return !is_far ? std::string()
                   : fmt::format(
                         "gravity reads {:.4g} times what is expected: accel_pulse_mps = {:g} is not what a "
                         "pulse of this unit weighs",
                         ratio, info.accel_pulse_mps);
  const UnitSlip* const slip = slip_near(accel_slips(), ratio);
  if (slip == nullptr && !is_far) return {};
  return fmt::format("gravity reads {:.3g} where {:.3g} m/s^2 is expected: the accelerometers look {}",
                     ratio * info.gravity_mps2, info.gravity_mps2,
                     slip != nullptr ? slip->words : "to be something else, or of another unit or scale");
}

std::optional<GyroMap> gyro_map(std::size_t rows, const std::function<MotionSums(std::size_t)>& row) {
  const auto plus = [](const MotionSums& a, const MotionSums& b, double sign) {
    return MotionSums{a.duration_s + sign * b.duration_s, a.gyro + sign * b.gyro, a.accel + sign * b.accel};
  };
  constexpr double piece_s = 0.05;
  std::vector<MotionSums> until{1};  // from the first row to the end of each piece
  MotionSums now;
  for (std::size_t k = 0; k < rows; ++k) {
    now = plus(now, row(k), 1.0);
    if (now.duration_s - until.back().duration_s >= piece_s) until.push_back(now);
  }
  const auto force = [](const MotionSums& sums) { return sums.accel.norm() / sums.duration_s; };
  const auto between = [&](std::size_t from, std::size_t to) { return plus(until[to], until[from], -1.0); };
  std::vector<double> forces;
  for (std::size_t k = 1; k < until.size(); ++k) forces.push_back(force(between(k - 1, k)));
  const double usual = forces.empty() ? 0.0 : median(forces);
  struct Step {
    Eigen::Vector3d change, up, turn;
  };
  std::optional<GyroMap> best;
  double least = 0.5;
  for (const std::size_t width : {2, 4, 8}) {
    std::vector<Step> steps;
    double moved = 0.0;
    for (std::size_t k = 0; k + 2 * width < until.size(); k += width) {
      const MotionSums before = between(k, k + width), after = between(k + width, k + 2 * width);
      if (std::max(std::abs(force(before) / usual - 1.0), std::abs(force(after) / usual - 1.0)) > 0.1) continue;
      const Eigen::Vector3d from = before.accel.normalized(), to = after.accel.normalized(), change = to - from;
      if (change.norm() < 0.02 || change.norm() > 0.5) continue;
      steps.push_back({change, (from + to).normalized(), between(k + width / 2, k + 3 * width / 2).gyro});
      moved += change.squaredNorm();
    }
    constexpr std::size_t fewest = 5, fewest_of_48 = 12;
    for (const Eigen::Matrix3d& axes : signed_axes()) {
      double both = 0.0, turned = 0.0;
      for (const Step& step : steps) {
        const Eigen::Vector3d turn = -(axes * step.turn).cross(step.up);
        both += step.change.dot(turn);
        turned += turn.squaredNorm();
      }
      const bool own = axes.isIdentity();
      const double left = 1.0 - both * both / (turned * moved), weighed = own ? 0.5 * left : left;
      if (steps.size() < (own ? fewest : fewest_of_48) || !(both > 0.0 && left < 0.5 && weighed < least)) continue;
      least = weighed;
      best = GyroMap{axes, both / turned};
    }
  }
  return best;
}

std::string wrong_accelerometers(const CompressedRecording& recording) {
  const SensorModel model = sensor_model(start_parameters(recording.info), recording.info);
  std::vector<double> ratios;
  const bool rests = std::ranges::any_of(recording.blocks, &Block::whole_second);
  for (const Block& block : recording.blocks)
    if (block.whole_second || !rests)
      ratios.push_back((model.accel_scale * block.accel).norm() / (block.duration_s * recording.info.gravity_mps2));
  return ratios.empty() ? std::string() : wrong_gravity(median(ratios), recording.info);
}

std::string wrong_axes(const Eigen::Matrix3d& n) {
  constexpr double far = 0.5;  // of the scale factor: 30 deg from its axis
  if ((n - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < far) return {};
  std::string wrong;
  for (int i = 0; i < 3; ++i) {
    int most = 0;
    n.row(i).cwiseAbs().maxCoeff(&most);
    // No single gyro reads this axis: the fit has ended elsewhere.
    if (n.row(i).cwiseAbs().sum() > (1.0 + far) * std::abs(n(i, most)) || std::abs(n(i, most)) < far)
      return "signs or axes: no turn carries gravity from rest to rest as the gyros read it";
    if (most == i && n(i, i) > 0.0) continue;
    wrong += wrong.empty() ? "signs or axes: " : ", ";
    wrong += std::string("the rate about ") + "xyz"[i] + " is what gyro " + "xyz"[most] + " reads" +
             (n(i, most) < 0.0 ? ", reversed" : "");
  }
  return wrong;
}

std::string wrong_table_axes(const CompressedRecording& recording, const Eigen::Matrix3d& mounting) {
  const auto attitude = [&](const Segment& s) { return Eigen::Matrix3d(attitude_at(angles_of(s)) * mounting); };
  Eigen::Matrix3d turned = Eigen::Matrix3d::Zero(), felt = Eigen::Matrix3d::Zero();
  for (const TableTurn& turn : table_turns(recording)) {
    // A hundredth of the turn gives its direction, however often it goes round.
    const std::size_t segment = recording.blocks[turn.first].segment;
    const Segment& from = recording.segments[segment - 1];
    Segment begun = recording.segments[segment];
    begun.heading_deg = from.heading_deg + 0.01 * (begun.heading_deg - from.heading_deg);
    begun.pitch_deg = from.pitch_deg + 0.01 * (begun.pitch_deg - from.pitch_deg);
    begun.roll_deg = from.roll_deg + 0.01 * (begun.roll_deg - from.roll_deg);
    const Eigen::AngleAxisd first(Eigen::Matrix3d(attitude(from).transpose() * attitude(begun)));
    turned += turn.commanded_rad * first.axis() * turn.felt.transpose();
    felt += turn.felt * turn.felt.transpose();
  }
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(felt);
  return lu.rcond() > 1e-3 ? wrong_axes(turned * lu.inverse()) : "";
}

std::string wrong_table_units(const CompressedRecording& recording) {
  const RecordingInfo& info = recording.info;
  std::string both = wrong_accelerometers(recording);
  const std::string gyros = info.gyro_increment == IncrementKind::physical ? wrong_gyros(recording) : std::string();
  if (!both.empty() && !gyros.empty()) both += "; ";
  return both + gyros;
}

}  // namespace turncal
