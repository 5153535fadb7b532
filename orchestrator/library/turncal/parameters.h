// The parameters of a unit, as in a parameter file (docs/files.md), and their application to a recording.
//
//   rate = n * gyro counts / period - N0        force = a * accelerometer counts / period - A0
#pragma once

#include <array>
#include <memory>
#include <optional>
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
  static Parameters read(const std::string& path);  // undetermined parameters are an error, too
  static Parameters parse(const std::string& text, const std::string& name = "parameters");  // accepts any content
  std::string text() const;                                                                  // text of the file
  void write(const std::string& path) const;

  std::array<double, 24> values() const;
  std::array<double, 24> sigmas() const;  // NaN: not estimated
  bool trusted() const;                   // false: its sigmas are not credible
  // Returns every key of the file, in order, without the checksum; effects as effect.NAME.COMPONENT (docs/diagnosis.md).
  std::vector<std::pair<std::string, std::string>> items() const;

  struct Content;
  explicit Parameters(std::shared_ptr<const Content> content) : content_(std::move(content)) {}
  const Content& content() const { return *content_; }

 private:
  std::shared_ptr<const Content> content_;
};

// Returns the number of an item, of a parameter file or a diagnosis; none of a text. A serial and a hash are texts, whatever their digits.
TURNCAL_API std::optional<double> number_of(const std::pair<std::string, std::string>& item);

// `turncal apply`: returns the recording with calibrated increments, rad and m/s, with effects subtracted. Divided by the period they are rates and
// specific forces. An error when the parameters are of another unit or kind of increment.
TURNCAL_API Recording apply(const Recording& recording, const Parameters& parameters);

}  // namespace turncal::v0
