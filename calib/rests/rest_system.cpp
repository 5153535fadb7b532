#include "calib/rests/rest_system.h"

#include <Eigen/Geometry>
#include <cmath>

#include "calib/model/attitude.h"
#include "calib/statistics/block_motion.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Matrix23 = Eigen::Matrix<double, 2, 3>;

// The direction of a specific force, with derivatives.
struct Direction {
  Vector3d u;
  double norm = 0.0;
  Matrix3Xd columns;  // du
};

// Returns the derivatives of f / |f| from those of f.
Matrix3Xd unit_columns(const Direction& d) { return (d.columns - d.u * (d.u.transpose() * d.columns)) / d.norm; }

class Builder {
 public:
  Builder(const RestData& data, const Parameters& parameters, const EffectModel& effects, bool with_columns)
      : data_(data),
        recording_(*data.recording),
        effects_(effects),
        model_(sensor_model(parameters, recording_.info)),
        unit_(si_per_unit(recording_.info)),
        p_(with_columns ? rest_parameter_count + effects.columns : 0) {
    regressors_ = EffectRegressors(effects.columns);
  }

  RestSystem build() {
    Eigen::Index rows = 4 * data_.rests.size();
    for (const RestLeg& leg : data_.legs) rows += leg.fault.empty() ? 2 : 0;
    rows_.resize(rows, p_ + 1);
    system_.white_variance.resize(rows);
    RestState from;
    for (std::size_t k = 0; k < data_.rests.size(); ++k) {
      if (k == 0) {
        from = rest_state(data_.rests[0], Matrix3d::Identity());
        add_rest(0, from);
        continue;
      }
      const RestLeg& leg = data_.legs[k - 1];
      Matrix3Xd turns;
      const Matrix3d C = navigate(leg, from, turns);
      if (!leg.fault.empty()) ++stretch_;
      RestState to = rest_state(data_.rests[k], from.C_nb * C);
      add_rest(k, to);
      if (leg.fault.empty()) add_leg(k - 1, from, to, C, turns);
      from = std::move(to);
    }
    take_off_horizontal_earth_rate();
    system_.residual = rows_.col(p_);
    if (p_ > 0) system_.jacobian = rows_.leftCols(p_);
    return std::move(system_);
  }

 private:
  struct RestState {
    Direction whole, first_edge, last_edge;
    Matrix3Xd gyro_regressors;
    Matrix3d C_nb;
  };

  Eigen::Index row_count() const { return std::ssize(system_.kind); }
  void add_row(RestKind kind, std::size_t owner, double residual, const Eigen::Ref<const Eigen::RowVectorXd>& columns,
               double white_variance) {
    rows_.row(row_count()).head(p_) = columns;
    rows_(row_count(), p_) = residual;
    system_.white_variance[row_count()] = white_variance;
    system_.kind.push_back(kind);
    system_.owner.push_back(int(owner));
  }

  BlockState block_state(const Block& block) const {
    BlockState s;
    s.f_b = model_.accel_scale * block.accel / block.duration_s - model_.accel_bias_mps2;
    s.w_b.setZero();
    s.w_dot_b.setZero();
    s.C_nb.setIdentity();
    s.duration_s = block.duration_s;
    s.time_s = recording_.middle_s(block);
    s.since_rotation_s = 1e9;
    take_temperature(block, effects_.reference_temperature_c, s);
    return s;
  }

  // Averages the effects' regressors over the blocks of a part of a rest.
  void mean_regressors(const Rest& rest, const RestMean& part, const Vector3d& f_b, const Matrix3d& C_nb,
                       Matrix3Xd& gyro, Matrix3Xd& accel) {
    gyro.setZero(3, effects_.columns);
    accel.setZero(3, effects_.columns);
    if (effects_.columns == 0) return;
    double total_s = 0.0;
    for (std::size_t k = part.first_block; k < part.end_block; ++k) {
      const Block& block = recording_.blocks[k];
      BlockState s = block_state(block);
      s.f_b = f_b;
      s.C_nb = C_nb;
      s.since_rotation_s = s.time_s - rest.start_s + (part.first_block == 0 ? 1e9 : 0.0);
      effects_.regressors(s, regressors_);
      gyro += regressors_.gyro * block.duration_s;
      accel += regressors_.accel * block.duration_s;
      total_s += block.duration_s;
    }
    gyro /= total_s;
    accel /= total_s;
  }

  Direction direction(const RestMean& part, const Matrix3Xd& accel_regressors) const {
    Direction d;
    Vector3d f = model_.accel_scale * part.accel - model_.accel_bias_mps2;
    if (effects_.columns > 0) f -= accel_regressors * effects_.values;
    d.norm = f.norm();
    d.u = f / d.norm;
    if (p_ == 0) return d;
    d.columns.setZero(3, p_);  // of f
    const auto& indices = free_parameters();
    for (int c = 0; c < rest_parameter_count; ++c) {
      const int index = indices[c];
      if (index >= 15)
        d.columns((index - 15) / 3, c) = unit_[index] * part.accel[(index - 15) % 3];
      else if (index >= 3 && index < 6)
        d.columns(index - 3, c) = -unit_[index];
    }
    d.columns.rightCols(effects_.columns) = -accel_regressors;
    return d;
  }

  RestState rest_state(const Rest& rest, const Matrix3d& heading_from) {
    RestState state;
    const Vector3d f = model_.accel_scale * rest.whole.accel - model_.accel_bias_mps2;
    state.C_nb = level(heading_from, f);
    Matrix3Xd accel;
    Matrix3Xd gyro_of_edge;
    mean_regressors(rest, rest.whole, f, state.C_nb, state.gyro_regressors, accel);
    state.whole = direction(rest.whole, accel);
    mean_regressors(rest, rest.first_edge, f, state.C_nb, gyro_of_edge, accel);
    state.first_edge = direction(rest.first_edge, accel);
    mean_regressors(rest, rest.last_edge, f, state.C_nb, gyro_of_edge, accel);
    state.last_edge = direction(rest.last_edge, accel);
    return state;
  }

  void add_rest(std::size_t index, const RestState& state) {
    const Rest& rest = data_.rests[index];
    const Vector3d accel_white = model_.accel_scale * data_.accel_white;
    const Vector3d gyro_white = model_.gyro_scale * data_.gyro_white;
    const Vector3d& u = state.whole.u;
    add_row(RestKind::norm, index, state.whole.norm - recording_.info.gravity_mps2, u.transpose() * state.whole.columns,
            u.cwiseProduct(accel_white).squaredNorm() / rest.whole.duration_s);

    const double t = rest.between_s;
    const Vector3d middle = (state.first_edge.u + state.last_edge.u).normalized();
    const Vector3d creep = (state.last_edge.u - state.first_edge.u).cross(middle) / t;
    const double earth_up = earth_rate_n(recording_.info.latitude_deg)[1];
    Vector3d w = model_.gyro_scale * rest.gyro_between - model_.gyro_bias_radps - creep - earth_up * u;
    if (effects_.columns > 0) w -= state.gyro_regressors * effects_.values;
    Matrix3Xd w_columns = Matrix3Xd::Zero(3, p_);
    if (p_ > 0) {
      const auto& indices = free_parameters();
      for (int c = 0; c < rest_parameter_count; ++c) {
        const int k = indices[c];
        if (k < 3)
          w_columns(k, c) = -unit_[k];
        else if (k >= 6 && k < 15)
          w_columns((k - 6) / 3, c) = unit_[k] * rest.gyro_between[(k - 6) % 3];
      }
      w_columns.rightCols(effects_.columns) = -state.gyro_regressors;
    }
    const double edge_s = std::min(rest.first_edge.duration_s, rest.last_edge.duration_s);
    const double tilt = accel_white.squaredNorm() / 3.0 / edge_s / std::pow(recording_.info.gravity_mps2, 2);
    const Matrix3d C_bn = state.C_nb.transpose();
    gyros_feel_.push_back({row_count(), C_bn(Eigen::all, {0, 2}), stretch_});
    for (int axis = 0; axis < 3; ++axis)
      add_row(RestKind::gyro, index, w[axis], w_columns.row(axis),
              std::pow(gyro_white[axis], 2) / t + 2.0 * tilt / (t * t) * (1.0 - u[axis] * u[axis]));
  }

  void add_leg(std::size_t index, const RestState& from, const RestState& to, const Matrix3d& C,
               const Matrix3Xd& turns) {
    const RestLeg& leg = data_.legs[index];
    const Vector3d& u = from.last_edge.u;
    const Vector3d& v = to.first_edge.u;
    const Matrix23 basis = axes_across(v);
    const Vector3d predicted = C.transpose() * u;
    const Eigen::Vector2d residual = basis * (predicted - v);
    const Matrix3Xd du = unit_columns(from.last_edge);
    // d(C' u) = C' (du - turns x u) = C' (du + [u x] turns)
    const Matrix3Xd end = C.transpose() * (du + skew(u) * turns);
    const Eigen::Matrix2Xd columns = basis * (end - unit_columns(to.first_edge));
    const Matrix3d C_bn = to.C_nb.transpose();
    legs_feel_.push_back({row_count(), leg.duration_s * basis * skew(v) * C_bn(Eigen::all, {0, 2}), stretch_});
    const double gyro = (model_.gyro_scale * data_.gyro_white).squaredNorm() / 3.0 * leg.duration_s;
    const double accel =
        (model_.accel_scale * data_.accel_white).squaredNorm() / 3.0 / std::pow(recording_.info.gravity_mps2, 2) *
        (1.0 / data_.rests[leg.from].last_edge.duration_s + 1.0 / data_.rests[leg.from + 1].first_edge.duration_s);
    for (int k = 0; k < 2; ++k) add_row(RestKind::direction, index, residual[k], columns.row(k), gyro + accel);
  }

  // Returns the product of the leg's rotations; `turns` collects C_before Jl dr for every column.
  Matrix3d navigate(const RestLeg& leg, const RestState& from, Matrix3Xd& turns) {
    Matrix3d C = Matrix3d::Identity();
    turns.setZero(3, p_);
    BlockDerivatives base;
    const auto& indices = free_parameters();
    const std::vector<Block>& blocks = recording_.blocks;
    const auto rate = [&](std::size_t k) -> Vector3d {
      return model_.gyro_scale * blocks[k].gyro / blocks[k].duration_s - model_.gyro_bias_radps;
    };
    for (std::size_t k = leg.first_block; k < leg.end_block; ++k) {
      const Block& block = blocks[k];
      const double t = block.duration_s;
      BlockMotion motion = evaluate(block, model_, recording_.info.sample_period_s);
      if (effects_.columns > 0) {
        BlockState s = block_state(block);
        s.w_b = motion.rotation / t;
        const std::size_t a = std::max(k, leg.first_block + 1) - 1;
        const std::size_t b = std::min(k + 1, leg.end_block - 1);
        if (b > a) s.w_dot_b = (rate(b) - rate(a)) / (recording_.middle_s(blocks[b]) - recording_.middle_s(blocks[a]));
        s.C_nb = from.C_nb * C * rotation_exp(0.5 * motion.rotation);
        effects_.regressors(s, regressors_);
        motion.rotation -= regressors_.gyro * effects_.values * t;
      }
      if (p_ > 0) {
        differentiate(block, motion, model_, unit_, false, base);
        const Matrix3d turn = C * left_jacobian(motion.rotation);
        Eigen::Matrix<double, 3, rest_parameter_count> free;
        for (int c = 0; c < rest_parameter_count; ++c) free.col(c) = base.rotation.row(indices[c]).transpose();
        turns.leftCols<rest_parameter_count>().noalias() += turn * free;
        if (effects_.columns > 0) turns.rightCols(effects_.columns).noalias() -= (t * turn) * regressors_.gyro;
      }
      C = (C * rotation_exp(motion.rotation)).eval();
    }
    return C;
  }

  // Removes h = (H'H + lambda I)^-1 H'w, estimated in each stretch from its gyro rows: rows and columns become less H h
  // (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, with equal weights). lambda = 2
  // sigma^2 / w_h^2, sigma^2 the mean square of the residual, at least that of the white noise.
  void take_off_horizontal_earth_rate() {
    const double w_h = earth_rate_n(recording_.info.latitude_deg)[0];
    const auto rows_of = [&](const Horizontal& h) -> Eigen::MatrixXd {  // columns, residual
      return rows_.middleRows(h.row, h.felt.rows());
    };
    for (int stretch = 0; stretch <= stretch_; ++stretch) {
      Eigen::Matrix2d HH = Eigen::Matrix2d::Zero();
      Eigen::Matrix2Xd Hw = Eigen::Matrix2Xd::Zero(2, p_ + 1);
      double white = 0.0, square = 0.0, count = 0.0;
      for (const Horizontal& h : gyros_feel_) {
        if (h.stretch != stretch) continue;
        const Eigen::MatrixXd all = rows_of(h);
        HH += h.felt.transpose() * h.felt;
        Hw += h.felt.transpose() * all;
        square += all.col(p_).squaredNorm();
        for (int k = 0; k < 3; ++k) white += system_.white_variance[h.row + k];
        count += 3.0;
      }
      const auto solve = [&](double variance) -> Eigen::Matrix2Xd {
        return (HH + 2.0 * variance / (w_h * w_h) * Eigen::Matrix2d::Identity()).inverse() * Hw;
      };
      if (!(count > 0.0) || !(white > 0.0)) continue;
      const Eigen::Vector2d first = solve(white / count).col(p_);
      const double left = square - 2.0 * first.dot(Hw.col(p_)) + first.dot(HH * first);
      const Eigen::Matrix2Xd h_and_columns = solve(std::max(white, left) / count);
      for (const auto* feel : {&gyros_feel_, &legs_feel_})
        for (const Horizontal& h : *feel) {
          if (h.stretch != stretch) continue;
          const Eigen::MatrixXd less = rows_of(h) - h.felt * h_and_columns;
          rows_.middleRows(h.row, less.rows()) = less;
        }
    }
  }

  const RestData& data_;
  const CompressedRecording& recording_;
  const EffectModel& effects_;
  const SensorModel model_;
  const ParameterVector unit_;
  const int p_;
  EffectRegressors regressors_;
  RestSystem system_;
  Eigen::MatrixXd rows_;  // the columns, the residual
  // Derivatives of rows by h: three gyro rows of a rest, two rows of a leg.
  struct Horizontal {
    Eigen::Index row;
    Eigen::MatrixX2d felt;
    int stretch;  // number of legs with a fault before it
  };
  std::vector<Horizontal> gyros_feel_, legs_feel_;
  int stretch_ = 0;
};

}  // namespace

Eigen::Matrix<double, 2, 3> axes_across(const Vector3d& v) {
  Eigen::Index smallest = 0;
  v.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 2, 3> basis;
  basis.row(0) = v.cross(Vector3d::Unit(smallest)).normalized();
  basis.row(1) = v.cross(basis.row(0).transpose());
  return basis;
}

const char* to_string(RestKind kind) {
  constexpr const char* names[] = {"gravity norm at rest", "gravity direction after a rotation", "gyros at rest"};
  return names[index(kind)];
}

RestSystem make_rest_system(const RestData& data, const Parameters& parameters, const EffectModel& effects,
                            bool with_columns) {
  return Builder(data, parameters, effects, with_columns).build();
}

RestErrors rest_errors(const RestSystem& system, const Eigen::VectorXd& residual) {
  double sum[rest_kind_count] = {};
  double count[rest_kind_count] = {};
  for (Eigen::Index k = 0; k < residual.size(); ++k) {
    if (std::isnan(residual[k])) continue;
    const auto kind = index(system.kind[k]);
    sum[kind] += residual[k] * residual[k];
    count[kind] += kind == index(RestKind::direction) ? 0.5 : 1.0;  // an angle has two components
  }
  const auto rms = [&](RestKind kind) {
    const auto k = index(kind);
    return count[k] > 0.0 ? std::sqrt(sum[k] / count[k]) : 0.0;
  };
  return {rms(RestKind::norm), rms(RestKind::direction), rms(RestKind::gyro)};
}

}  // namespace turncal
