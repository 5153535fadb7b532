#include "calib/joint/joint_filter.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include <Eigen/Cholesky>

#include "calib/joint/linear_motion.h"
#include "calib/statistics/numerics.h"

namespace turncal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d inverse_of_lower(const Matrix3d& L) {
  Matrix3d inverse = Matrix3d::Zero();
  for (int k = 0; k < 3; ++k) inverse(k, k) = 1.0 / L(k, k);
  inverse(1, 0) = -L(1, 0) * inverse(0, 0) * inverse(1, 1);
  inverse(2, 1) = -L(2, 1) * inverse(1, 1) * inverse(2, 2);
  inverse(2, 0) = -(L(2, 0) * inverse(0, 0) + L(2, 1) * inverse(1, 0)) * inverse(2, 2);
  return inverse;
}

// The filter. Its state is psi, v and, with bias instability, b_g, b_a; 3x3 blocks couple them over an interval (linear_motion.h).
template <int NS>  // 6: psi, v;  12: psi, v, b_g, b_a
class Filter {
 public:
  Filter(const FilterSetup& setup, const std::vector<double>& source_weights, int columns)
      : setup_(setup),
        weights_(source_weights),
        walk_(walk_noise(setup.noise)),
        instability_(setup.noise.bias_instability().cwiseAbs2()),
        p_(columns) {
    X_.setZero(p_, NS);
    N_.setZero(p_, 3);
    scratch_.setZero(p_, 3);
    buffer_.setZero(p_ + 1, 96);
    moments_.setZero(p_ + 1, p_ + 1);
    P_.setZero();
  }

  // `kept`: the interval is one block at rest; receives the update if it is observed.
  void step(const LinearInterval& interval, FilterStep* kept = nullptr) {
    kept_ = kept;
    begin(interval);
    if constexpr (NS == 12) rho_ = std::exp(-interval.t / setup_.noise.bias_correlation_s);
    if (interval.still)
      rest(interval);
    else
      turn(interval);
    P_ = (0.5 * (P_ + P_.transpose())).eval();
    was_still_ = interval.still;
  }

  FilterResult take() {
    end_chain();
    flush();
    if (p_ > 0) {
      result_.information = moments_.topLeftCorner(p_, p_).template selfadjointView<Eigen::Lower>();
      result_.gradient = moments_.row(p_).head(p_).transpose();
    }
    return std::move(result_);
  }

 private:
  using State = Eigen::Matrix<double, NS, 1>;
  using Covariance = Eigen::Matrix<double, NS, NS>;
  using Cross = Eigen::Matrix<double, NS, 3>;
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  void begin(const LinearInterval& interval) {
    if (interval.begins_chain) {
      end_chain();
      in_chain_ = true;
      x_.template head<6>().setZero();
      X_.leftCols(6).setZero();
      const bool first = result_.heading_error_rad.empty() || interval.begins_recording;
      if constexpr (NS == 12) {
        if (first) {
          x_.template tail<6>().setZero();
          X_.rightCols(6).setZero();
          P_.template bottomRightCorner<6, 6>().setZero();
          P_.diagonal().template tail<6>() = instability_;
        }
        P_.template rightCols<6>().template topRows<6>().setZero();
        P_.template leftCols<6>().template bottomRows<6>().setZero();
      }
      P_.template topLeftCorner<6, 6>().setZero();
      const double tilt = std::pow(setup_.initial_tilt_sigma_rad, 2);
      P_.diagonal().template head<3>() << tilt, std::pow(setup_.initial_heading_sigma_rad, 2), tilt;
      P_.diagonal().template segment<3>(3).setConstant(first ? std::pow(setup_.initial_velocity_sigma_mps, 2)
                                                             : std::max(interval.cut_v, 1.0));
      free_ = x_;
      return;
    }
    P_.diagonal().template segment<3>(0).array() += interval.cut_psi;
    P_.diagonal().template segment<3>(3).array() += interval.cut_v;
    x_.template segment<3>(0) -= interval.jump_psi;
    x_.template segment<3>(3) -= interval.jump_v;
    free_.template segment<3>(0) -= interval.jump_psi;
    free_.template segment<3>(3) -= interval.jump_v;
    if (was_still_ && !interval.still) {  // a rotation begins: free_ restarts from the estimate
      free_ = x_;
      free_.template segment<3>(3) = interval.v_start;
    }
  }

  void end_chain() {
    if (!in_chain_) return;
    result_.heading_error_rad.push_back(x_[1]);
    result_.heading_sigma_rad.push_back(std::sqrt(std::max(P_(1, 1), 0.0)));
    if (p_ > 0) result_.heading_by_parameter.push_back(-X_.col(1));
  }

  void rest(const LinearInterval& i) {
    const double t = i.t;
    const StepNoise q = step_noise(i.C * (walk_.gyro + i.filled.gyro).asDiagonal() * i.C.transpose(),
                                   i.C * (walk_.accel + i.filled.accel).asDiagonal() * i.C.transpose(), i.F, t);
    Q_.template block<3, 3>(0, 0) = q.psi_psi;
    Q_.template block<3, 3>(0, 3) = q.psi_v;
    Q_.template block<3, 3>(3, 0) = q.psi_v.transpose();
    Q_.template block<3, 3>(3, 3) = q.v_v;

    // Mean velocity = y + H (psi, v, b_g, b_a) with H = [by_psi, I, by_bg, by_ba]
    const bool predicted = i.observed || setup_.keep_innovations;  // left out, but predicted
    const Matrix3d by_psi = -0.5 * t * i.F;
    Matrix3d by_bg, by_ba;
    if constexpr (NS == 12) {
      by_bg = (-t * t / 6.0) * (i.F * i.C);
      by_ba = (0.5 * t) * i.C;
    }
    const auto seen = [&](const auto& rows) {
      Eigen::Matrix<double, 3, std::decay_t<decltype(rows)>::ColsAtCompileTime> sum =
          by_psi * rows.template topRows<3>() + rows.template middleRows<3>(3);
      if constexpr (NS == 12)
        sum.noalias() += by_bg * rows.template middleRows<3>(6) + by_ba * rows.template middleRows<3>(9);
      return sum;
    };
    Matrix3d S = Matrix3d::Identity();
    Cross M = Cross::Zero();  // cov(state at the end, nu)
    Vector3d nu = i.y;
    Vector3d free_mean = i.y;
    if (predicted) {
      const Cross PH = seen(P_).transpose();
      S = seen(PH) + q.z_z + i.C * i.quantisation.asDiagonal() * i.C.transpose();
      M = moved(i, PH);
      M.template topRows<3>() += q.psi_z;
      M.template block<3, 3>(3, 0) += q.v_z;
      nu -= seen(x_);
      if (setup_.keep_innovations) free_mean -= seen(free_);
    }
    if (p_ > 0 && i.observed) {
      N_ = X_.template middleCols<3>(3) + i.D;
      add_product(X_.template leftCols<3>(), by_psi.transpose(), N_);
      if constexpr (NS == 12) {
        add_product(X_.template middleCols<3>(6), by_bg.transpose(), N_);
        add_product(X_.template middleCols<3>(9), by_ba.transpose(), N_);
      }
    }
    predict(i);
    if (predicted) {
      const Matrix3d L = S.llt().matrixL();
      const Matrix3d whiten = inverse_of_lower(L);
      if (setup_.keep_innovations) {
        (i.observed ? result_.innovations : result_.left_out)
            .push_back({i.block, i.time_s, nu, whiten * nu, free_mean});
        if (i.observed) result_.covariances.push_back(S);
      }
      if (i.observed) update(nu, L, whiten, M);
    }
  }

  void turn(const LinearInterval& i) {
    Q_.setZero();
    for (std::size_t k = 0; k < i.noise.size(); ++k) {
      const LinearInterval::Entered& n = i.noise[k];
      const double weight = k < weights_.size() ? weights_[k] : 1.0;
      Q_.template block<3, 3>(0, 0) += weight * n.psi_psi;
      Q_.template block<3, 3>(0, 3) += weight * n.psi_v;
      Q_.template block<3, 3>(3, 0) += weight * n.psi_v.transpose();
      Q_.template block<3, 3>(3, 3) += weight * n.v_v;
    }
    predict(i);
  }

  // Returns the transition times a matrix of NS rows.
  template <class Rows>
  Rows moved(const LinearInterval& i, const Rows& rows) const {
    Rows result;
    const auto psi = rows.template topRows<3>();
    result.template topRows<3>().noalias() = i.turn * psi;
    result.template middleRows<3>(3) = rows.template middleRows<3>(3);
    result.template middleRows<3>(3).noalias() += i.v_psi * psi;
    if constexpr (NS == 12) {
      const auto b_g = rows.template middleRows<3>(6);
      result.template topRows<3>().noalias() += i.psi_bg * b_g;
      result.template middleRows<3>(3).noalias() += i.v_bg * b_g;
      result.template middleRows<3>(3).noalias() += i.v_ba * rows.template middleRows<3>(9);
      result.template bottomRows<6>() = rho_ * rows.template bottomRows<6>();
    }
    return result;
  }

  // Predicts state and covariance over the interval; Q_ is the noise that enters.
  void predict(const LinearInterval& i) {
    x_ = moved(i, x_);
    if (setup_.keep_innovations) free_ = moved(i, free_);
    const Covariance half = moved(i, P_);
    P_ = moved(i, Covariance(half.transpose()));
    P_.template topLeftCorner<6, 6>() += Q_;
    if constexpr (NS == 12) P_.diagonal().template tail<6>() += (1.0 - rho_ * rho_) * instability_;
    if (p_ > 0) predict_columns(i);
  }

  void predict_columns(const LinearInterval& i) {
    scratch_ = X_.template leftCols<3>();
    auto psi = X_.template leftCols<3>();
    auto v = X_.template middleCols<3>(3);
    set_product(scratch_, i.turn.transpose(), psi);
    psi += i.B_psi;
    add_product(scratch_, i.v_psi.transpose(), v);
    v += i.B_v;
    if constexpr (NS == 12) {
      const auto b_g = X_.template middleCols<3>(6), b_a = X_.template middleCols<3>(9);
      add_product(b_g, i.psi_bg.transpose(), psi);
      add_product(b_g, i.v_bg.transpose(), v);
      add_product(b_a, i.v_ba.transpose(), v);
      X_.template rightCols<6>() *= rho_;
    }
  }

  void update(const Vector3d& nu, const Matrix3d& L, const Matrix3d& whiten, const Cross& M) {
    const Matrix3d S_inverse = whiten.transpose() * whiten;
    result_.chi_square += (whiten * nu).squaredNorm();
    result_.log_determinant += 2.0 * std::log(L.diagonal().prod());
    result_.observations += 3;
    accumulate(nu, whiten);
    const Cross K = M * S_inverse;
    P_.noalias() -= K.lazyProduct(M.transpose());
    for (int k = 0; k < NS && p_ > 0; k += 3)
      add_product(N_, -K.template middleRows<3>(k).transpose(), X_.template middleCols<3>(k));
    x_ += K * nu;
    if (!kept_) return;
    kept_->observed = true;
    kept_->K.template topRows<NS>() = K;
    kept_->nu = nu;
    kept_->S_inverse = S_inverse;
    kept_->N = N_;
  }

  void accumulate(const Vector3d& nu, const Matrix3d& whiten) {
    if (p_ == 0) return;
    // Whitened rows: L^-1 N', L^-1 nu
    set_product(N_, whiten.transpose(), buffer_.block(0, buffered_, p_, 3));
    buffer_.block(p_, buffered_, 1, 3) = (whiten * nu).transpose();
    buffered_ += 3;
    if (buffered_ + 3 > buffer_.cols()) flush();
  }

  void flush() {
    if (buffered_ == 0) return;
    add_moments(buffer_.leftCols(buffered_), moments_);
    buffered_ = 0;
  }

  const FilterSetup& setup_;
  const std::vector<double>& weights_;
  const WalkNoise walk_;
  const Eigen::Matrix<double, 6, 1> instability_;  // variances of b_g, b_a
  const int p_;                                    // parameters and effect components
  bool in_chain_ = false;
  bool was_still_ = false;
  double rho_ = 1.0;            // decay of b_g, b_a over the interval
  State x_ = State::Zero();     // estimated error of the navigated motion
  State free_ = State::Zero();  // the same, without updates since the last rotation began; for reports
  Covariance P_;
  Matrix6d Q_;                                   // of psi, v
  Eigen::Matrix<double, Eigen::Dynamic, NS> X_;  // p x NS
  Columns N_, scratch_;
  Eigen::MatrixXd buffer_;  // (p + 1) x 96: whitened rows waiting to be added to the information
  int buffered_ = 0;
  Eigen::MatrixXd moments_;  // (p + 1)^2: [N nu]' [N nu], lower triangle
  FilterResult result_;
  FilterStep* kept_ = nullptr;
};

using AnyFilter = std::variant<Filter<6>, Filter<12>>;
AnyFilter filter_of(const FilterSetup& setup, const std::vector<double>& weights, int columns) {
  if (setup.noise.has_bias_instability()) return AnyFilter(std::in_place_type<Filter<12>>, setup, weights, columns);
  return AnyFilter(std::in_place_type<Filter<6>>, setup, weights, columns);
}

}  // namespace

FilterResult run_filter(const CompressedRecording& recording, const Parameters& parameters, const EffectModel& effects,
                        const FilterSetup& setup) {
  return std::move(run_filter(recording, parameters, effects, setup, std::vector{setup.noise}).front());
}

std::vector<FilterResult> run_filter(const CompressedRecording& recording, const Parameters& parameters,
                                     const EffectModel& effects, const FilterSetup& setup,
                                     const std::vector<NoiseModel>& noises) {
  LinearMotion motion(recording, parameters, effects, setup, {setup.with_columns, {walk_noise(noises.front())}});
  const int columns = setup.with_columns ? parameter_count + effects.columns : 0;
  const std::vector<double> one = {1.0};
  std::vector<FilterSetup> setups(noises.size(), setup);
  std::vector<AnyFilter> filters;
  filters.reserve(noises.size());
  for (std::size_t k = 0; k < noises.size(); ++k) {
    setups[k].noise = noises[k];
    filters.push_back(filter_of(setups[k], one, columns));
  }
  for (LinearInterval interval; motion.next(interval);) {
    FilterStep* const kept = setup.keep_steps && interval.still ? &motion.steps.back() : nullptr;
    for (auto& filter : filters) std::visit([&](auto& f) { f.step(interval, kept); }, filter);
  }
  std::vector<FilterResult> results;
  for (auto& filter : filters) results.push_back(std::visit([](auto& f) { return f.take(); }, filter));
  results.front().steps = std::move(motion.steps);
  results.front().taken_off = std::move(motion.taken_off);
  return results;
}

FilterResult run_filter(const std::vector<LinearInterval>& intervals, const FilterSetup& setup,
                        const std::vector<double>& source_weights) {
  const Eigen::Index columns = setup.with_columns && !intervals.empty() ? intervals.front().B_psi.rows() : 0;
  AnyFilter filter = filter_of(setup, source_weights, int(columns));
  const auto pass = [&](auto& f) {
    for (const LinearInterval& interval : intervals) f.step(interval);
    return f.take();
  };
  return std::visit(pass, filter);
}

}  // namespace turncal
