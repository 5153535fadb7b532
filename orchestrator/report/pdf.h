// A page as PDF, by weasyprint within two minutes (piped_program.h).
#pragma once

#include <string>

#include "calib/types/status.h"

namespace turncal {

// What there is to warn of, for people, in one line; empty: nothing. An error leaves no file.
Result<std::string> write_pdf(const std::string& html, const std::string& path);

}  // namespace turncal
