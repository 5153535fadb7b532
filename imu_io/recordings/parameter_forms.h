// A parameter file in other forms, for whoever loads it into a navigation computer: a C header, a binary block with a checksum, YAML.
//
// Formats: docs/parameter-forms.md. All numbers are those of the parameter file, in its units (calib/model/parameters.h); C and YAML
// have them in the shortest form that reads back as the same double. Simulated and untrusted files say so in every form.
#pragma once

#include <string>

#include "imu_io/recordings/parameter_file.h"

namespace turncal {

std::string format_parameter_block(const ParameterFile& file);
std::string format_parameter_header(const ParameterFile& file);
std::string format_parameter_yaml(const ParameterFile& file);

}  // namespace turncal
