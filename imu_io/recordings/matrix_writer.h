// Columns of numbers as NumPy's .npy, MATLAB's .mat or CSV, by the name of the file; and recordings in these forms.
//
// .npy: one array of doubles ('<f8'), a row a sample, columns in the order given. .mat (version 5): a column vector of doubles for each
// name, a point in it as an underscore. CSV: a header of the names. The same content gives the same bytes.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"
#include "imu_io/recordings/recording_source.h"

namespace turncal {

struct NumberColumn {
  std::string name;
  std::vector<double> values;  // as many as in the others
};

// Whether the name ends in .npy or .mat.
bool names_matrix(std::string_view path);

// An input error for a name that ends in none of `endings` (".npy"), in small letters.
Status check_ending(std::string_view path, std::initializer_list<std::string_view> endings);

// Whole or not at all. A file that is there is replaced by one of its own kind only.
Status write_columns(const std::string& path, const std::vector<NumberColumn>& fields);

// A row a sample: sample, segment (its number from 1; 0: none), gyro_x to accel_z, and where they are, temperature_c and flags. .npy in two
// passes, in memory that does not grow; .mat in a pass for each column and one more, with a column in memory.
Status write_recording_columns(RecordingSource& source, const std::string& path);

}  // namespace turncal
