// What to say when somebody names a thing that is not there: a unit of a queue, of a store or of a database.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/base/text.h"

namespace turncal {

// Returns "WHERE: there is no unit 'SN17'; did you mean 'SN1'?" unless `known` has the name; without any: "there is none".
inline Status check_known(const std::string& where, const std::string& what, const std::string& name,
                          const std::vector<std::string>& known) {
  if (std::ranges::find(known, name) != known.end()) return {};
  return input_error(where + ": there is no " + what + " " + turncal::quoted(name) +
                     (known.empty() ? ": there is none at all" : did_you_mean(name, known)));
}

}  // namespace turncal
