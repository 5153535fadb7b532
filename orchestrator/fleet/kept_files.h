// What earlier calibrations have left, wherever it is kept: in files below a folder (of runs, or a store of `turncal recalibrate`), or in the
// rows of a results database.
#pragma once

#include <functional>
#include <string>

#include "calib/types/status.h"

namespace turncal {

// `where`: the file, or the database and its row.
using EachKeptFile = std::function<void(const std::string& where, const Result<std::string>& contents)>;

// Every file called `name`, parameters.conf or statistics.tcs: below a folder in the order of paths, but for folders that begin with a dot; of a
// database the newest of each recording. Errors: what cannot be read at all.
Status each_kept_file(const std::string& source, const std::string& name, const EachKeptFile& each);

}  // namespace turncal
