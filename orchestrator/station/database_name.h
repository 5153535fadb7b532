// What a results database is called: the path of a file, or postgresql://USER@HOST:PORT/NAME for a server (docs/fleet.md).
#pragma once

#include <string>

#include "calib/types/status.h"

namespace turncal {

bool names_a_server(const std::string& database);
// A server's name, or the path of an SQLite file that is there.
bool names_a_database(const std::string& path);

// An input error, which does not repeat it, when a password is in the name of a server: it would be seen in files and by whoever lists
// the processes.
Status check_database_name(const std::string& database);

}  // namespace turncal
