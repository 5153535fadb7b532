#include "calib/prediction/design_bound.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <Eigen/Cholesky>

#include "calib/model/attitude.h"
#include "calib/prediction/planned_motion.h"

namespace turncal {
namespace {

constexpr int unknowns = 21, rows_each = 17;
constexpr int nodes = 40;  // of the integrals over a turn
// The disclosed attitude error, in parts: of the levelling error of the pose, and of the rotation of the gyros' axes
// against the accelerometers', which is fixed in the body. Any parts give a bound; the best of these is taken.
struct Policy {
  double levelled = 0.35, carried = 0.6;
};
constexpr std::array<Policy, 4> policies{{{0.35, 0.6}, {0.35, 0.0}, {0.7, 0.3}, {0.1, 0.6}}};
constexpr int first_rounds = 3, last_rounds = 12;
using Row = Eigen::Matrix<double, 1, unknowns>;
using SquareMatrix = Eigen::Matrix<double, unknowns, unknowns>;

// Rates of information of all turns and rests: rows, each divided by the root of the time, whose outer products sum up to it.
class Candidates {
 public:
  Candidates(const BoundTask& task, const ParameterVector& scale, const Policy& policy)
      : task_(task), scale_(scale), policy_(policy) {
    q_ = task.noise.angle_random_walk.cwiseAbs2().minCoeff();
    r_ = task.noise.velocity_random_walk.cwiseAbs2().minCoeff();
    std::size_t turns = 0;
    for (const auto& poses : task.poses_deg) turns += poses.size() > 1 ? 1 : 0;
    const std::size_t poses = task.poses_deg[1].size() * task.poses_deg[2].size();
    const std::size_t most = poses * (1 + 3 * turns * task.turns_deg.size() * task.rates_degps.size());
    rows_.resize((rows_each * most), unknowns);
    heading_.resize(most, unknowns);
    const double half_s = 0.5 * task.least_rest_s;
    // The table is level, so the heading of a pose changes nothing but the Earth's rate.
    AxisTriple at;
    at[Axis::heading] = task.poses_deg[0].front();
    for (const double pitch : task.poses_deg[1])
      for (const double roll : task.poses_deg[2]) {
        at[Axis::pitch] = pitch;
        at[Axis::roll] = roll;
        add_rest(at);
        for (const Axis axis : all_axes) {
          if (task.poses_deg[index(axis)].size() < 2) continue;
          for (const double turn : task.turns_deg)
            for (const double rate : task.rates_degps) {
              add_turn(at, axis, turn, rate, half_s, half_s);
              add_turn(at, axis, turn, rate, half_s, 0.0);
              add_turn(at, axis, turn, rate, 0.0, half_s);
            }
        }
      }
    little_ = 1e-7 / count_ * rows_.topRows(rows_each * count_).colwise().squaredNorm().transpose();
    little_ = (little_.array() > 0.0).select(little_, 1.0);
  }

  int count() const { return count_; }
  // Returns a negligible information on each parameter: 1e-7 of the candidates' mean.
  const Eigen::VectorXd& little() const { return little_; }
  auto rows(int k) const { return rows_.middleRows<rows_each>(rows_each * k); }
  // Returns <G, m> of each candidate for G = L L'.
  Eigen::VectorXd values(const SquareMatrix& L) const {
    const Eigen::VectorXd squares = (rows_.topRows(rows_each * count_) * L).rowwise().squaredNorm();
    return squares.reshaped(rows_each, count_).colwise().sum().transpose();
  }
  // Returns what the free heading can add to <G, M> in the whole time: it drifts by at most h t, and the Earth's rate turns it into tilt.
  double of_heading(const SquareMatrix& L) const {
    const double h_square = (heading_.topRows(count_) * L).rowwise().squaredNorm().maxCoeff();
    const double earth = earth_rate_radps * std::cos(task_.info.latitude_deg * rad_per_deg);
    return earth * earth * h_square * std::pow(task_.time_s, 3) / (12.0 * q_);
  }

 private:
  Row in_aims(const Eigen::Matrix<double, 1, parameter_count>& si) const {
    return (si.cwiseProduct(scale_.transpose()))(free_parameters());
  }
  using Rows24 = Eigen::Matrix<double, 3, parameter_count>;
  // C delta omega and C delta f, n frame: derivatives by the parameters in SI.
  static Rows24 turned_wrong(const Eigen::Matrix3d& C, const Eigen::Vector3d& rate_b) {
    return felt_wrong(C, rate_b, 0, 6);
  }
  Rows24 pushed_wrong(const Eigen::Matrix3d& C) const {
    return felt_wrong(C, C.transpose() * Eigen::Vector3d(0.0, task_.info.gravity_mps2, 0.0), 3, 15);
  }
  static Rows24 felt_wrong(const Eigen::Matrix3d& C, const Eigen::Vector3d& felt_b, int bias, int matrix) {
    Rows24 rows = Rows24::Zero();
    rows.middleCols<3>(bias) = -C;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) rows.col(matrix + 3 * i + j) = C.col(i) * felt_b[j];
    return rows;
  }
  // f x psi for f = (0, g, 0).
  Rows24 tilted(const Rows24& psi) const {
    Rows24 rows = Rows24::Zero();
    rows.row(0) = task_.info.gravity_mps2 * psi.row(2);
    rows.row(2) = -task_.info.gravity_mps2 * psi.row(0);
    return rows;
  }
  // Returns the disclosed attitude error: the policy's parts of the error that holds the levelled velocity at zero, and of the triads' rotation.
  Rows24 said(const Eigen::Matrix3d& C) const {
    const Rows24 push = pushed_wrong(C);
    Rows24 psi = Rows24::Zero();
    psi.row(2) = -policy_.levelled / task_.info.gravity_mps2 * push.row(0);
    psi.row(0) = policy_.levelled / task_.info.gravity_mps2 * push.row(2);
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      for (const int row : {0, 2}) {
        psi(row, 6 + 3 * j + i) += 0.5 * policy_.carried * C(row, k);
        psi(row, 6 + 3 * i + j) -= 0.5 * policy_.carried * C(row, k);
      }
    }
    return psi;
  }
  // Adds the next row of a candidate.
  void put(const Rows24& rows, int axis, double weight) { rows_.row(at_row_++) = weight * in_aims(rows.row(axis)); }
  void done(const Row& heading) {
    heading_.row(count_++) = heading;
    while (at_row_ < rows_each * count_) rows_.row(at_row_++).setZero();
  }

  // Adds a rest of t seconds: the inputs that move the attitude error evenly by y, and hold it `off` in the mean from the disclosed one.
  void put_rest(const Eigen::Matrix3d& C, const Rows24& y, const Rows24& off, double t, double per_root_s) {
    const Rows24 wrong = turned_wrong(C, Eigen::Vector3d::Zero()) + y / t;
    const Rows24 push = pushed_wrong(C) + tilted(said(C) + off);
    for (const int axis : {0, 2}) put(wrong, axis, std::sqrt(t / q_) * per_root_s);
    for (const int axis : {0, 1, 2}) put(push, axis, std::sqrt(t / r_) * per_root_s);
  }

  void add_rest(const AxisTriple& at) {
    const Eigen::Matrix3d C = attitude_at(at);
    put_rest(C, Rows24::Zero(), Rows24::Zero(), 1.0, 1.0);
    done(in_aims(turned_wrong(C, Eigen::Vector3d::Zero()).row(1)));
  }

  // Adds half a rest, the turn, half a rest. Of two turns with no rest between them each has only the half on its outer side.
  void add_turn(const AxisTriple& at, Axis axis, double turn_deg, double rate_degps, double before_s, double after_s) {
    const double moving_s = trapezoid_duration_s(turn_deg, rate_degps, task_.acceleration_degps2);
    const double t = moving_s + task_.settle_s;
    const double g = task_.info.gravity_mps2;
    const double dt = t / nodes;
    const Eigen::Matrix3d C = attitude_at(at);
    const Eigen::Vector3d u = axis_b(axis, at);
    const auto after = [&](double angle_rad) { return Eigen::Matrix3d(C * Eigen::AngleAxisd(angle_rad, u)); };
    std::array<Rows24, nodes> until;  // integral of C delta omega up to mid-interval
    Rows24 felt = Rows24::Zero(), v = Rows24::Zero();
    double angle_rad = 0.0;
    for (std::size_t k = 0; k < nodes; ++k) {
      const double end_s = std::min((double(k) + 1.0) * dt, moving_s);
      const double end_rad = trapezoid_angle_deg(turn_deg, rate_degps, task_.acceleration_degps2, end_s) * rad_per_deg;
      const Eigen::Matrix3d C_middle = after(0.5 * (angle_rad + end_rad));
      const Rows24 wrong = dt * turned_wrong(C_middle, u * ((end_rad - angle_rad) / dt));
      until[k] = felt + 0.5 * wrong;
      felt += wrong;
      v += dt * pushed_wrong(C_middle);
      angle_rad = end_rad;
    }
    const Eigen::Matrix3d C_after = after(angle_rad);
    const Rows24 first = said(C);
    const Rows24 psi = said(C_after) - first + felt;
    // Each half rest takes the part that costs least in noise.
    const double rest_s = std::max(before_s, after_s), sides = (before_s + after_s) / rest_s;
    const double in_turn = 1.0 / (q_ * t), in_rest = 1.0 / (q_ * rest_s) + g * g * rest_s / (3.0 * r_);
    const double part = in_turn / (sides * in_turn + in_rest);
    const double begins = before_s > 0.0 ? part : 0.0, in_turns = 1.0 - sides * part;
    for (std::size_t k = 0; k < nodes; ++k)
      v += dt * tilted(first + (begins + in_turns * (double(k) + 0.5) / nodes) * psi - until[k]);
    const double per_root_s = 1.0 / std::sqrt(t + before_s + after_s);
    if (before_s > 0.0) put_rest(C, part * psi, 0.5 * part * psi, before_s, per_root_s);
    if (after_s > 0.0) put_rest(C_after, part * psi, -0.5 * part * psi, after_s, per_root_s);
    for (const int k : {0, 2}) {
      put(psi, k, g * part * std::sqrt((before_s + after_s) / (12.0 * r_)) * per_root_s);
      put(psi, k, in_turns / std::sqrt(q_ * t) * per_root_s);
      put(v, k, per_root_s / std::sqrt(r_ * t + g * g * q_ * std::pow(t, 3) / 12.0));
    }
    put(v, 1, per_root_s / std::sqrt(r_ * t));
    const Rows24 standing =
        before_s * turned_wrong(C, Eigen::Vector3d::Zero()) + after_s * turned_wrong(C_after, Eigen::Vector3d::Zero());
    done(in_aims(felt.row(1) + standing.row(1)) * (per_root_s * per_root_s));
  }

  const BoundTask& task_;
  const ParameterVector& scale_;
  const Policy policy_;
  double q_ = 0.0, r_ = 0.0;
  Eigen::MatrixXd rows_, heading_;
  Eigen::VectorXd little_;
  int count_ = 0, at_row_ = 0;
};

struct Gradient {
  SquareMatrix L;             // G = L L'
  Eigen::VectorXd log_sigma;  // of M
};
Gradient gradient_at(const SquareMatrix& M, const Eigen::VectorXd& weight) {
  const SquareMatrix V = M.llt().solve(SquareMatrix::Identity());
  return {V * weight.cwiseQuotient(V.diagonal()).cwiseSqrt().asDiagonal(), 0.5 * V.diagonal().array().log()};
}

// Improves a continuous design, and keeps the greatest bound met on the way.
class Dual {
 public:
  Dual(const Candidates& candidates, const BoundTask& task) : candidates_(candidates), task_(task) {
    weight_.setZero(unknowns);
    for (int k = 0; k < unknowns; ++k) weight_[k] = task.aim[free_parameters()[k]] > 0.0;
    weight_ /= weight_.sum();
    const int every = std::max(1, candidates.count() / 300);
    for (int k = 0; k < candidates.count(); k += every) active_.push_back(k);
    share_.assign(active_.size(), 1.0 / double(active_.size()));
  }

  double improve(int rounds) {
    for (int round = 0; round < rounds; ++round) {
      for (int step = 0; step < steps; ++step) {
        const Gradient gradient = gradient_at(information(), weight_);
        for (std::size_t i = 0; i < active_.size(); ++i)
          share_[i] *= (candidates_.rows(active_[i]) * gradient.L).squaredNorm();
        normalise();
      }
      const Gradient gradient = gradient_at(information(), weight_);
      const Eigen::VectorXd values = candidates_.values(gradient.L);
      const double total = task_.time_s * values.maxCoeff() + candidates_.of_heading(gradient.L);
      const double bound = weight_.dot(gradient.log_sigma) - 0.5 * std::log(total);
      if (std::isfinite(bound)) best_ = std::max(best_, bound);
      if (task_.worst) weigh(gradient.log_sigma);
      bring_in(values);
    }
    return best_;
  }

 private:
  static constexpr int steps = 40, added = 40;

  // The largest is at least any weighted mean, so weight goes to what is large.
  void weigh(const Eigen::VectorXd& log_sigma) {
    const double mean = weight_.dot(log_sigma);
    weight_ = weight_.array() * (log_sigma.array() - mean).min(2.0).exp();
    weight_ /= weight_.sum();
  }
  SquareMatrix information() const {
    SquareMatrix M = SquareMatrix::Zero();
    for (std::size_t i = 0; i < active_.size(); ++i)
      M += share_[i] * candidates_.rows(active_[i]).transpose() * candidates_.rows(active_[i]);
    // A turn and its reverse differ in the sign of a gyro bias's effect beside the rest. With both in M it cancels, so one of them suffices.
    M.topRightCorner(3, unknowns - 3).setZero();
    M.bottomLeftCorner(unknowns - 3, 3).setZero();
    M.diagonal() += candidates_.little();  // any M gives a bound, as long as it can be inverted
    return M;
  }
  void normalise() {
    const double sum = std::accumulate(share_.begin(), share_.end(), 0.0);
    for (double& share : share_) share /= sum;
  }
  // Takes in the candidates that tell most, and drops those not used.
  void bring_in(const Eigen::VectorXd& values) {
    std::vector<int> order(values.size());
    std::iota(order.begin(), order.end(), 0);
    const auto most = std::min<std::ptrdiff_t>(added, values.size());
    std::partial_sort(order.begin(), order.begin() + most, order.end(),
                      [&](int a, int b) { return values[a] > values[b]; });
    std::size_t used = 0;
    for (std::size_t i = 0; i < active_.size(); ++i) {
      if (share_[i] < 1e-6) continue;
      active_[used] = active_[i];
      share_[used++] = share_[i];
    }
    active_.resize(used);
    share_.resize(used);
    for (auto k = order.begin(); k != order.begin() + most; ++k) {
      if (std::ranges::find(active_, *k) != active_.end()) continue;
      active_.push_back(*k);
      share_.push_back(0.3 / double(used + added));
    }
    normalise();
  }

  const Candidates& candidates_;
  const BoundTask& task_;
  Eigen::VectorXd weight_;
  std::vector<int> active_;
  std::vector<double> share_;
  double best_ = -std::numeric_limits<double>::infinity();
};

}  // namespace

std::optional<double> least_log_sigma(const BoundTask& task) {
  ParameterVector scale = si_per_unit(task.info);
  const Parameters nominal = start_parameters(task.info);
  scale.segment<9>(6).setConstant(1.0 / nominal.n(0, 0));
  scale.segment<9>(15).setConstant(1.0 / nominal.a(0, 0));
  for (int k = 0; k < parameter_count; ++k)
    if (task.aim[k] > 0.0) scale[k] *= task.aim[k];
  if (task.aim.maxCoeff() <= 0.0) return std::nullopt;
  double best = -std::numeric_limits<double>::infinity();
  Policy best_policy;
  for (const Policy& policy : policies) {
    const double bound = Dual(Candidates(task, scale, policy), task).improve(first_rounds);
    if (bound > best) best_policy = policy;
    best = std::max(best, bound);
  }
  best = std::max(best, Dual(Candidates(task, scale, best_policy), task).improve(last_rounds));
  if (!std::isfinite(best)) return std::nullopt;
  return best;
}

}  // namespace turncal
