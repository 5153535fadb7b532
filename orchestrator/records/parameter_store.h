// The parameter files in use, one a unit, with every version kept:
//
//   STORE/SERIAL/parameters.conf          the one in use, replaced atomically
//   STORE/SERIAL/versions/0001.conf ...   never changed, never removed
//
// Parameters from simulated data go below STORE/simulated/ and carry `simulated = true`: they are never a production file.
#pragma once

#include <string>
#include <vector>

#include "imu_io/recordings/parameter_file.h"

namespace turncal {

// A serial number as the name of a file or folder: what is no letter, digit, '-' or '_' as %xx.
std::string name_of_unit(const std::string& unit);
// Where a store keeps the files of a unit.
std::string unit_folder(const std::string& store, const std::string& unit, bool simulated);

// A version of its own unless the newest one has the same bytes; then in use. Both durable on success.
Status put_in_use(const std::string& store, const ParameterFile& file);
// Brings a version back into use.
Status restore_version(const std::string& store, const std::string& unit, int version, bool simulated);

struct StoredVersion {
  int number = 0;
  std::string path;
  bool in_use = false;
  Status status;  // an error: damaged, and there is no file
  ParameterFile file;
};
// An error when there is none; it says so where the unit has some of the other kind, simulated or not.
Result<std::vector<StoredVersion>> stored_versions(const std::string& store, const std::string& unit, bool simulated);

}  // namespace turncal
