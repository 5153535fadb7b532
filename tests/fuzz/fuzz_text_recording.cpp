// Bytes as the text form of a recording: recording.conf, imu.csv and segments.csv, with lines of "----" between them. An empty
// part stands for a right one, so that each of the three is reached alone. What can be opened must be readable to the end or say why
// not.
#include <array>
#include <string>
#include <string_view>

#include "imu_io/recordings/recording_source.h"
#include "input.h"
#include "scratch_file.h"

namespace {

constexpr std::array<std::string_view, 3> names = {"recording.conf", "imu.csv", "segments.csv"};
constexpr std::array<std::string_view, 3> right = {
    "format = 1\nsample_period_s = 0.005\nlatitude_deg = 30\ngravity_mps2 = 9.8\nunit_serial = F\ngyro_increment = "
    "pulses\n"
    "accel_increment = pulses\naccel_pulse_mps = 0.0005\n",
    "sample,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n",
    "step,kind,start_sample,end_sample,heading_deg,pitch_deg,roll_deg\n1,align,0,1,0,0,0\n1,static,1,3,0,90,0\n"};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace turncal;
  static const fuzz::ScratchFolder folder;
  static const std::array<fuzz::ScratchFile, 3> files = {fuzz::ScratchFile(folder, std::string(names[0])),
                                                         fuzz::ScratchFile(folder, std::string(names[1])),
                                                         fuzz::ScratchFile(folder, std::string(names[2]))};
  std::string_view rest = fuzz::Input(data, size).text();
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t end = rest.find("----\n");
    std::string_view part = rest.substr(0, end);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 5);
    if (part.empty()) part = right[i];
    files[i].write(std::as_bytes(std::span(part.data(), part.size())));
  }
  auto source = RecordingSource::open(folder.path());
  if (!fuzz::taken(source)) return 0;
  (void)fuzz::taken(fuzz::read_through(**source));
  return 0;
}
