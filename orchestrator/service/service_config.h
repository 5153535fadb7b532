// The stations that `turncal serve` shows, and who may act on them (docs/serve.md):
//
//   station.1         = east                              the name on the page; station.2 and so on without a gap
//   station.1.queue   = /var/lib/turncal/east/queue       of its batch
//   station.1.runs    = /var/lib/turncal/east/runs        the batch's --out
//   station.1.mounted = /var/lib/turncal/east/mounted     written by "mount done"; what hook.mount waits for
//   serve.password_file = /etc/turncal/operators          NAME:HASH a line; without it nothing can be changed
//   serve.database = postgresql://reader@host/line         or a file: what all its stations did in the last 24 hours
//
// Relative names are those beside the file. HASH is as crypt(5) has it (`openssl passwd -6`, `mkpasswd`). The password file is read again at
// every question, so that a name which is taken out is out at once; one that others than its owner and group can read is refused.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "calib/types/status.h"

namespace turncal {

// That it can be read, and that every line is a name and a hash.
Status check_operators(const std::string& path);
// The name in "Basic ..." (RFC 7617) when its password is right; an error when not, which does not say what was wrong.
Result<std::string> authorised_operator(const std::string& path, std::string_view authorization);

struct ServedStation {
  std::string name, queue, runs;
  std::string mounted;  // empty: a mounted unit is not announced by the page
};

struct ServiceConfig {
  std::vector<ServedStation> stations;  // at least one, names differ
  std::string password_file;            // empty: read-only
  std::string database;                 // empty: no results are shown
};

Result<ServiceConfig> read_service_config(const std::string& path);

}  // namespace turncal
