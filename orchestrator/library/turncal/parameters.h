// The parameters of a unit, as a parameter file has them (docs/files.md), and applied to a recording.
//
//   rate = n * gyro counts / period - N0        force = a * accelerometer counts / period - A0
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <turncal/error.h>
#include <turncal/recording.h>

namespace turncal::v0 {

// The order of every array of 24: N0 (3), deg/h; A0 (3), units of 9.80665 m/s^2; n (3 x 3, by rows), arcsec a pulse, or 1 of increments in
// rad; a (3 x 3, by rows), of the nominal pulse weight, or 1 of m/s. Here are their names: N01 ... A01 ... n11 n12 ... a33.
TURNCAL_API std::span<const std::string_view, 24> parameter_keys();

class TURNCAL_API Parameters {
 public:
  static Parameters read(const std::string& path);  // an error, too, where parameters are not determined
  static Parameters parse(const std::string& text, const std::string& name = "parameters");  // whatever it holds
  std::string text() const;                                                                  // of the file
  void write(const std::string& path) const;

  std::array<double, 24> values() const;
  std::array<double, 24> sigmas() const;  // NaN: not estimated
  bool trusted() const;                   // false: its sigmas cannot be believed
  // Every key of the file in its order, checksum left out: effects, too, as effect.NAME.COMPONENT (docs/diagnosis.md).
  std::vector<std::pair<std::string, std::string>> items() const;

  struct Content;
  explicit Parameters(std::shared_ptr<const Content> content) : content_(std::move(content)) {}
  const Content& content() const { return *content_; }

 private:
  std::shared_ptr<const Content> content_;
};

// `turncal apply`: the recording with calibrated increments, rad and m/s, effects taken off. Divided by the period they are rates and
// specific forces. An error where the parameters are another unit's or another kind of increment's.
TURNCAL_API Recording apply(const Recording& recording, const Parameters& parameters);

}  // namespace turncal::v0
