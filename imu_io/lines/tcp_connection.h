// A TCP connection to a device: made with a deadline, and given up when the caller wants something else.
#pragma once

#include <functional>
#include <string>

#include "calib/types/status.h"

namespace turncal {

// "host:port" -> a socket that does not block, is closed on exec and sends at once. `given_up` is asked at least every 10 ms. Errors: kind
// input for an address of another form, aborted when given up, else device. A name instead of a number is looked up by the system
// first, which has its own deadlines: give numbers.
Result<int> connect_tcp(const std::string& address, double timeout_s, const std::function<bool()>& given_up = {});

}  // namespace turncal
