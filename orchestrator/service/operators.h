// Who may act by the page: a file with NAME:HASH a line, HASH as crypt(5) has it (`openssl passwd -6`, `mkpasswd`). Read again at every
// question, so that a name which is taken out is out at once. A file that others than its owner and group can read is refused.
#pragma once

#include <string>
#include <string_view>

#include "calib/types/status.h"

namespace turncal {

// That it can be read, and that every line is a name and a hash.
Status check_operators(const std::string& path);
// The name in "Basic ..." (RFC 7617) when its password is right; an error when not, which does not say what was wrong.
Result<std::string> authorised_operator(const std::string& path, std::string_view authorization);

}  // namespace turncal
