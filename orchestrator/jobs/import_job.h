// Data taken elsewhere, once they are samples: what `turncal import` refuses of them and what it says.
#pragma once

#include <string>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/csv_map_import.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

// Returns what is plainly wrong with the units of measure, by rests or by the motion; empty: nothing.
std::string wrong_units_of(RecordingSource& source, const Segments& segments);

// Returns defects in the samples of an imported recording, a line each. `segments`: its rests.
Result<std::vector<std::string>> defects_of(RecordingSource& source, const Segments& segments);

// "12 samples of 12 rows, ..."; `accel`: the accelerometers' file, if they have their own.
std::string words_of(const CsvImport& content, const std::string& accel = {});

// Returns what there is to say of an import; wrong units are an error. `path`: of the recording; `where`: what defines its units.
Result<std::vector<std::string>> check_import(const CsvImport& content, const std::string& path, const char* where);

}  // namespace turncal
