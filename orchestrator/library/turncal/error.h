// What every function of the library throws, and how its names are exported.
//
// A call never prints and never exits; it keeps nothing from one call to the next, so that any number of threads may call at once, on the
// same objects where these are const. Objects are cheap to copy: they share what they hold and never change it.
// Units: SI, and where a name ends in one (_deg, _degph) that one. Arrays are x, y, z of the body frame: front, up, right.
#pragma once

#include <stdexcept>
#include <string>

#define TURNCAL_API __attribute__((visibility("default")))

namespace turncal::v0 {

// The values are the exit codes of the program.
enum class ErrorKind {
  input = 1,         // a file, a value or data that cannot be used
  unit_failed = 20,  // the data cannot be believed, or leave parameters open
  aborted = 30,
  device = 50,    // a disk, for one
  internal = 70,  // a mistake of the library
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

// Users write turncal::Error. The library does not see it so: the program has others of the same names in turncal.
#ifndef TURNCAL_LIBRARY
namespace turncal {
using namespace v0;
}
#endif
