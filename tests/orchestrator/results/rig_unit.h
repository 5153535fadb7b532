// For tests of what is done with a calibration: a unit of the rig, its recordings, and its true parameters as a file.
#pragma once

#include "imu_io/base/key_value.h"
#include "imu_io/recordings/parameter_file.h"
#include "imu_io/recordings/recording_source.h"
#include "tests/orchestrator/program.h"

namespace turncal {

inline constexpr const char* without_noise =
    "noise.gyro_random_walk_deg_per_rt_h = 0\nnoise.accel_random_walk_ug_per_rt_hz = 0\n"
    "noise.gyro_bias_instability_degph = 0\nnoise.accel_bias_instability_ug = 0\ntable_error.random_arcmin = 0\n";

class RigUnit : public Program {
 protected:
  // Unit SN7 through `steps` of a sequence, into the folder `out`; once for all tests.
  void record(const std::string& out, const std::string& rig, const std::string& steps) {
    write(out + ".rig", rig);
    write_sequence(out + ".seq", steps);
    made(out, "run --dry-run --capture-only --unit SN7 --rig " + out + ".rig --sequence " + out + ".seq --out " + out);
  }
  void write_sequence(const std::string& name, const std::string& steps) {
    write(name, "format = 1\nname = of_test\nrate_degps = 10\nacceleration_degps2 = 20\n" + steps);
  }
  // A calibration of a recording, its parameters still open.
  ParameterFile file_of(const std::string& recording) {
    ParameterFile file;
    describe_recording((*RecordingSource::open(path(recording)))->info(), file);
    file.model = "base";
    file.method = "joint";
    file.recording_hash = std::string(32, '0');
    file.software_version = "test";
    file.time_utc = "2026-01-31T12:00:00Z";
    return file;
  }
  ParameterFile truth_of(const std::string& recording) {
    KeyValueFile truth = result(recording + "/truth.conf");
    ParameterFile file = file_of(recording);
    for (std::size_t k = 0; k < parameter_keys.size(); ++k)
      file.parameters[Eigen::Index(k)] = truth.number(parameter_keys[k]);
    file.simulated = true;
    return file;
  }
  // `recording` as text in `out`, every sample as `change` leaves it: cells as in imu.csv; without cells it is lost.
  void retell(const std::string& recording, const std::string& out,
              const std::function<void(std::int64_t counter, std::vector<std::string>& cells)>& change) {
    std::filesystem::remove_all(folder_ / out);
    ASSERT_EQ(run({"export", recording, "--out", out}).code, 0);
    std::string text;
    for (const std::string& line : lines_of(file_text(folder_ / out / "imu.csv"))) {
      if (line.empty() || std::isdigit(static_cast<unsigned char>(line.front())) == 0) {
        text += line + '\n';
        continue;
      }
      std::vector<std::string> cells = lines_of(line, ',');
      change(std::stoll(cells.front()), cells);
      for (std::size_t k = 0; k < cells.size(); ++k) text += (k > 0 ? "," : "") + cells[k];
      if (!cells.empty()) text += '\n';
    }
    write(out + "/imu.csv", text);
  }
  // Without `count` samples from the one numbered `first` on.
  void lose(const std::string& recording, std::int64_t first, std::int64_t count, const std::string& out) {
    retell(recording, out, [=](std::int64_t counter, std::vector<std::string>& cells) {
      if (counter >= first && counter < first + count) cells.clear();
    });
  }
  // With this in one cell of one sample.
  void change(const std::string& recording, const std::string& out, std::int64_t at, std::size_t cell,
              const std::string& to) {
    retell(recording, out, [&](std::int64_t counter, std::vector<std::string>& cells) {
      if (counter == at) cells[cell] = to;
    });
  }
  Segments segments_of(const std::string& recording) { return (*RecordingSource::open(path(recording)))->segments(); }
  void keep(const ParameterFile& file, const std::string& name) { ASSERT_OK(write_parameter_file(file, path(name))); }
  KeyValueFile result(const std::string& name) { return *KeyValueFile::parse(file_text(folder_ / name), name); }
};

// Of `turncal navigate`: a unit at rest, and its true parameters or nearly.
class Navigate : public RigUnit {
 protected:
  // 300 s and 1700 s at rest at a heading of 30 deg, with a turn over and back in the middle, of a unit without noise; its true parameters.
  void record_rest_and_truth() {
    record("rest", std::string(without_noise) + "seed = 31\n",
           "step 1\n  initial H 30 P 0 R 0\n  align 60000\n  dwell 140000\n  rotate P +90\n  dwell 60000\n"
           "  rotate P -90\n  dwell 140000\n");
    write_truth("rest", "true.conf");
  }
  // The true parameters as a file, but for `change` of one of them.
  void write_truth(const std::string& recording, const std::string& name, int parameter = 0, double change = 0.0) {
    ParameterFile file = truth_of(recording);
    file.parameters[parameter] += change;
    keep(file, name);
  }
};

}  // namespace turncal
