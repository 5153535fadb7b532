// Runs imu_tk's multi-position calibration (Tedaldi, Pretto, Menegatti, ICRA 2014) on a table of rates and specific forces. Not part of the
// program: scripts/peers compiles it against a clone of https://github.com/Kyle-ak/imu_tk, of which nothing is kept here.
//
//   imu_tk_driver RATES.csv GRAVITY INITIAL_REST_S OUT
//
// RATES.csv: header, then t (s), gyro x y z (rad/s), accelerometer x y z (m/s^2). OUT: 33 numbers, M_g, b_g, M_a, b_a, S of
// w = M_g (raw - b_g) - S f, f = M_a (raw - b_a). imu_tk says X' = T K (X - B) of both triads: M = T K, b = B; it has no S.
// Settings are those of its own example program but for the means: every sample of a rest counts, not its first hundred.
// Compiled with -O0 and linked first: setters in imu_tk's headers return nothing where they promise a number, which optimised code does not survive.
// Not modelled by imu_tk: the earth's rate, which stays in the gyro biases. Exit code 2: it found no calibration, and said why on stdout.
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "imu_tk/calibration.h"
#include "imu_tk/visualization.h"

// The calibration draws when it is verbose, which it is not: these stand in for OpenGL and gnuplot.
namespace imu_tk {
Plot::Plot() {}
template <>
void Plot::plotIntervals<double>(const std::vector<TriadData>&, const std::vector<DataInterval>&, DataInterval) {}
template <>
void Plot::plotIntervals<float>(const std::vector<TriadData_<float>>&, const std::vector<DataInterval>&, DataInterval) {
}
void waitForKey() {}
}  // namespace imu_tk

namespace {
bool read_rates(const char* path, std::vector<imu_tk::TriadData>& gyro, std::vector<imu_tk::TriadData>& accel) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) return false;
  while (std::getline(file, line)) {
    double t = 0, w[3], f[3];
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf,%lf", &t, &w[0], &w[1], &w[2], &f[0], &f[1], &f[2]) != 7)
      return false;
    gyro.emplace_back(t, w[0], w[1], w[2]);
    accel.emplace_back(t, f[0], f[1], f[2]);
  }
  return !gyro.empty();
}

void print(FILE* out, const imu_tk::CalibratedTriad& triad) {
  const Eigen::Matrix3d m = triad.getMisalignmentMatrix() * triad.getScaleMatrix();
  for (int row = 0; row < 3; ++row) std::fprintf(out, "%.17g %.17g %.17g\n", m(row, 0), m(row, 1), m(row, 2));
  const Eigen::Vector3d b = triad.getBiasVector();
  std::fprintf(out, "%.17g %.17g %.17g\n", b(0), b(1), b(2));
}
}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: imu_tk_driver RATES.csv GRAVITY INITIAL_REST_S OUT\n");
    return 1;
  }
  std::vector<imu_tk::TriadData> gyro, accel;
  if (!read_rates(argv[1], gyro, accel)) {
    std::fprintf(stderr, "%s: not a table of seven numbers a row\n", argv[1]);
    return 1;
  }
  imu_tk::MultiPosCalibration calibration;
  calibration.setGravityMagnitude(std::stod(argv[2]));
  calibration.setInitStaticIntervalDuration(std::stod(argv[3]));
  calibration.enableAccUseMeans(true);
  if (!calibration.calibrateAccGyro(accel, gyro)) return 2;
  FILE* out = std::fopen(argv[4], "w");
  if (out == nullptr) return 1;
  print(out, calibration.getGyroCalib());
  print(out, calibration.getAccCalib());
  std::fprintf(out, "0 0 0\n0 0 0\n0 0 0\n");
  return std::fclose(out) == 0 ? 0 : 1;
}
