#include "calib/evidence/felt_latitude.h"

#include "calib/model/limits.h"
#include "tests/rig_recorder.h"
#include "tests/test.h"

namespace turncal {
namespace {

std::optional<FeltLatitude> felt_in(const CompressedRecording& recording, JointResult& fit) {
  JointOptions options;
  options.candidates = latitude_columns();
  fit = joint_estimate(recording, options);
  return felt_latitude(recording, fit);
}

// Eight units at eight sites, told the truth and a latitude that is 0.3 deg off: what is felt is the true one both times, within
// its sigma (chi square of 8 stays below 26.1 but for one time in a thousand), which is 0.05 deg at
// most where the latitude is right. (A wrong one looks like bias instability, too, and widens it.)
TEST(FeltLatitude, IsTheTrueOneWhateverIsTold) {
  double chi_square[2] = {};
  for (int draw = 0; draw < 8; ++draw) {
    RigConfig config = default_rig_config();
    config.seed = 40 + std::uint64_t(draw);
    config.site.latitude_deg = -70.0 + 18.0 * draw;
    CompressedRecording recording = record_on_rig(fourteen_steps(), config).recording;
    for (const bool wrong : {false, true}) {
      recording.info.latitude_deg = config.site.latitude_deg + (wrong ? 0.3 : 0.0);
      JointResult fit;
      const std::optional<FeltLatitude> felt = felt_in(recording, fit);
      ASSERT_TRUE(felt.has_value());
      chi_square[wrong] += std::pow((felt->latitude_rad - config.site.latitude_deg * rad_per_deg) / felt->sigma_rad, 2);
      EXPECT_TRUE(wrong || felt->sigma_rad < 0.05 * rad_per_deg) << config.site.latitude_deg;
      EXPECT_EQ(felt->speaks_against(recording.info.latitude_deg * rad_per_deg, latitude_limits.least_deg), wrong);
    }
  }
  EXPECT_LT(chi_square[0], 26.1);
  EXPECT_LT(chi_square[1], 26.1);
}

// So far off that the gyros' biases stay open: the reason is felt all the same.
TEST(FeltLatitude, IsTheTrueOneWhereBiasesStayOpen) {
  const RigConfig config = default_rig_config();
  CompressedRecording recording = record_on_rig(fourteen_steps(), config).recording;
  const double latitude_deg = config.site.latitude_deg;
  for (const double stated_deg : {latitude_deg + 15.0, latitude_deg - 40.0, -latitude_deg}) {
    recording.info.latitude_deg = stated_deg;
    JointResult fit;
    const std::optional<FeltLatitude> felt = felt_in(recording, fit);
    EXPECT_FALSE(fit.undetermined.empty()) << stated_deg;
    ASSERT_TRUE(felt.has_value()) << stated_deg;
    EXPECT_NEAR(felt->latitude_rad, latitude_deg * rad_per_deg, 4.0 * felt->sigma_rad) << stated_deg;
    EXPECT_LT(felt->sigma_rad, 0.1 * rad_per_deg) << stated_deg;
    EXPECT_TRUE(felt->speaks_against(stated_deg * rad_per_deg, latitude_limits.least_deg));
  }
}

// A latitude and its mirror have the same rate north. Where the rate up is hardly felt (a MEMS gyro's bias instability in ten minutes), the
// mirror may be the nearer one, and the sigma there, which the rate north gives, is small.
TEST(FeltLatitude, ItsMirrorIsNoReasonWhereOnlyTheRateNorthIsFelt) {
  CompressedRecording recording;
  recording.info.latitude_deg = 57.7;
  JointResult fit;
  fit.converged = true;
  fit.free = free_parameters();
  const auto size = Eigen::Index(fit.free.size());
  fit.covariance = Eigen::MatrixXd::Identity(size, size);
  fit.unseen_instability = Eigen::MatrixXd::Zero(size, size);
  fit.last.information = Eigen::MatrixXd::Identity(parameter_count + 2, parameter_count + 2);
  fit.last.gradient = Eigen::VectorXd::Zero(parameter_count + 2);
  const auto felt = [&](double sigma_up_degph) {
    const Eigen::Vector2d information(1.0, 1.0 / (sigma_up_degph * sigma_up_degph)), off(0.3, -25.0);
    fit.last.information.diagonal().tail<2>() = information;
    fit.last.gradient.tail<2>() = -information.cwiseProduct(off);
    return wrong_latitude(recording, fit);
  };
  EXPECT_EQ(felt(12.0), "");
  EXPECT_SAYS(felt(1.0), "of a latitude of -5");
}

}  // namespace
}  // namespace turncal
