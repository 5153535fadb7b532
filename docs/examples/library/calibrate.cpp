// Calibrates a recording and says how fast the unit turned, calibrated, in its first rest.
//   calibrate RECORDING PARAMETERS.CONF
//   g++ -std=c++20 calibrate.cpp -o calibrate $(pkg-config --cflags --libs turncal)
#include <cmath>
#include <cstdio>

#include <turncal/calibrate.h>

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: %s RECORDING PARAMETERS.CONF\n", argv[0]);
    return 1;
  }
  try {
    const auto recording = turncal::Recording::load(argv[1]);
    const auto result = turncal::calibrate(recording);
    const auto values = result.parameters.values(), sigmas = result.parameters.sigmas();
    for (std::size_t k = 0; k < values.size(); ++k)
      std::printf("%s %.9g +- %.2g\n", turncal::parameter_keys()[k].data(), values[k], sigmas[k]);
    if (!result.distrust.empty()) std::printf("not trusted: %s\n", result.distrust.c_str());
    result.parameters.write(argv[2]);

    // Increments in rad: their sum over a rest is the angle that the earth has turned.
    const auto calibrated = turncal::apply(recording, result.parameters);
    const turncal::Segment& rest = calibrated.segments().front();
    double angle_rad[3] = {}, time_s = 0.0;
    for (const turncal::Sample& sample : calibrated.samples()) {
      if (sample.counter < rest.start_sample || sample.counter >= rest.end_sample) continue;
      for (int k = 0; k < 3; ++k) angle_rad[k] += sample.gyro[k];
      time_s += calibrated.info().sample_period_s;
    }
    const double rate_radps = std::hypot(angle_rad[0], angle_rad[1], angle_rad[2]) / time_s;
    std::printf("rate at rest %.4f deg/h\n", rate_radps * 180.0 / 3.14159265358979 * 3600.0);
    return result.distrust.empty() ? 0 : 20;
  } catch (const turncal::Error& error) {
    std::fprintf(stderr, "calibrate: %s\n", error.what());
    return error.exit_code();
  }
}
