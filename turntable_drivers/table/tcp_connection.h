// A TCP connection to a table: made with a deadline, and given up for a stop.
#pragma once

#include <string>

#include "calib/types/status.h"
#include "turntable_drivers/table/stop_signal.h"

namespace turncal {

// "host:port" -> a socket that does not block, is closed on exec and sends at once. Errors: kind input for an address of another
// form, aborted for a stop, else device. A name instead of a number is looked up by the system first, which has its own deadlines:
// give numbers.
Result<int> connect_tcp(const std::string& address, double timeout_s, const StopSignal& stop);

}  // namespace turncal
