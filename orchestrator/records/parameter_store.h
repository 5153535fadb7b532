// The parameter file in use of each unit, with all versions:
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

// Returns a serial number as the name of a file or folder: %xx replaces whatever is not a letter, digit, '-' or '_'.
std::string name_of_unit(const std::string& unit);
// Returns the folder of a unit in a store.
std::string unit_folder(const std::string& store, const std::string& unit, bool simulated);

// Stores a new version, unless the newest has the same bytes, and puts it in use. Both are durable on success.
Status put_in_use(const std::string& store, const ParameterFile& file);
// Brings a version back into use.
Status restore_version(const std::string& store, const std::string& unit, int version, bool simulated);

struct StoredVersion {
  int number = 0;
  std::string path;
  bool in_use = false;
  Status status;  // an error when damaged; there is no `file` then
  ParameterFile file;
};
// Returns all versions of a unit. An error when there are none, which says so if the unit has some of the other kind, simulated or not.
Result<std::vector<StoredVersion>> stored_versions(const std::string& store, const std::string& unit, bool simulated);

}  // namespace turncal
