// The exception that every function of the library throws, and the export of its names.
//
// A call never prints and never exits. It keeps no state between calls, so any number of threads may call at once, on the
// same objects if these are const. Objects are cheap to copy: they share their contents and never change them.
// Units: SI, or the unit at the end of a name (_deg, _degph). Arrays are x, y, z of the body frame: front, up, right.
#pragma once

#include <stdexcept>
#include <string>

#define TURNCAL_API __attribute__((visibility("default")))

namespace turncal::v0 {

// The values are the program's exit codes.
enum class ErrorKind {
  input = 1,         // an unusable file, value or data
  unit_failed = 20,  // the data are not credible, or leave parameters undetermined
  aborted = 30,
  device = 50,    // for example a disk
  internal = 70,  // a defect of the library
  interrupted = 75
};

// what() is the line that the program prints after "turncal: ".
class TURNCAL_API Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& line) : std::runtime_error(line), kind_(kind) {}
  ~Error() override;
  ErrorKind kind() const { return kind_; }
  int exit_code() const { return int(kind_); }

 private:
  ErrorKind kind_;
};

}  // namespace turncal::v0

// Users write turncal::Error. The library itself does not, because the program has other types of the same names in turncal.
#ifndef TURNCAL_LIBRARY
namespace turncal {
using namespace v0;
}
#endif
