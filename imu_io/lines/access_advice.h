// What to do about a device that could not be opened.
#pragma once

#include <string>

namespace turncal {

// number: the errno. "; its group may: sudo adduser "$USER" dialout, then log in again" where that helps, else nothing.
std::string access_advice(const std::string& device, int number);

}  // namespace turncal
